"""The road near an object, from the camera's path: it lies a known height below each camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshslam.geometry import Floats, GroundPlane, Pose
from meshslam.objects.config import ObjectConfig

_SLOPE_SIGMA = 0.03  # of streets, along and across
_NEAR_M = 10.0  # how far along the path the road counts as one plane
_REACH_M = 39 * _NEAR_M


def road_points(world_from_camera: Sequence[Pose], height_m: float) -> Floats:
    """Points (n, 3) of the road below each camera; the world's z is up."""
    return np.array([pose.translation - [0.0, 0.0, height_m] for pose in world_from_camera])


def ground_near(points_on_road: Floats, position: Floats, config: ObjectConfig) -> GroundPlane:
    """Fit the road z = z0 + a (x - px) + b (y - py) near `position` (3,) by weighted least squares.

    Slopes have a prior; the further the path keeps from the object, the less is known of its height.
    """
    count, points_on_road = len(points_on_road), _in_reach(points_on_road, position)
    away = points_on_road[:, :2] - position[:2]
    distance = np.linalg.norm(away, axis=1)
    nearest = float(distance.min())
    weight = np.exp(-0.5 * ((distance - nearest) / _NEAR_M) ** 2) / config.ground_height_sigma_m**2
    rows = np.column_stack([np.ones(len(away)), away])
    normal = rows.T @ (weight[:, None] * rows) / max(1.0, np.sqrt(count))
    normal += np.diag([0.0, _SLOPE_SIGMA**-2, _SLOPE_SIGMA**-2])
    right = rows.T @ (weight * points_on_road[:, 2]) / max(1.0, np.sqrt(count))
    z0, a, b = np.round(np.linalg.solve(normal, right), 10)  # its last bits vary with memory's alignment
    up = np.array([-a, -b, 1.0]) / np.sqrt(a * a + b * b + 1.0)
    sigma = float(np.hypot(config.ground_height_sigma_m, config.ground_slope_sigma * nearest))
    offset = float(up @ [position[0], position[1], z0])
    return GroundPlane(up, offset, sigma, config.ground_tilt_sigma_rad)


def _in_reach(points: Floats, position: Floats) -> Floats:
    """Those of a long path that have a weight: exp(-x) is 0 for all that are further than the nearest by `_REACH_M`."""
    x, y = points[:, 0] - position[0], points[:, 1] - position[1]
    squared = x * x + y * y
    reach = (np.sqrt(squared.min()) + _REACH_M) ** 2
    return points if squared.max() < reach else points[squared < reach]
