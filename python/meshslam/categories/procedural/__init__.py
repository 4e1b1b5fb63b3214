"""Procedural families: parametric solids from which a category's shape space is built."""
