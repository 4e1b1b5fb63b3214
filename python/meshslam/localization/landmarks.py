"""Objects of a run: each time that one comes into view is a landmark of its own, until it is known again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Pose
from meshslam.geometry.arrays import Floats


@dataclass
class Landmark:
    """An object as one stay in view shows it."""

    number: int
    track: int
    world_from_object: Pose  # in the world of the odometry, as last seen
    z: Floats
    dimensions: Floats  # (3,), length, width, height
    views: int = 0
    nearest_m: float = np.inf
    last_way_m: float = 0.0  # how far the camera had come when it was last seen


def growth(category: Category) -> Floats:
    """Modes (M,), of unit length, that come nearest to making the mean shape larger as a whole."""
    modes = category.modes.reshape(len(category.modes), -1).T
    found: Floats = np.linalg.lstsq(modes, category.vertices.ravel(), rcond=None)[0]
    return found / np.linalg.norm(found)
