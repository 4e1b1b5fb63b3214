"""Categories of objects: template mesh, key points and shape space; the procedural families; the builder."""

from meshslam.categories.category import Category, category_names, load_category, save_category

__all__ = ["Category", "category_names", "load_category", "save_category"]
