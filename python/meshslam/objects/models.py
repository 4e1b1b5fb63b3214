"""The observation model of a category."""

from __future__ import annotations

from meshslam.categories import Category
from meshslam.geometry import ObjectModel


def category_model(category: Category) -> ObjectModel:
    """The observation model of a category's objects."""
    return ObjectModel(
        category.vertices,
        category.faces,
        category.modes,
        category.mirror,
        category.keypoint_weights,
        category.wheel_vertices,
    )
