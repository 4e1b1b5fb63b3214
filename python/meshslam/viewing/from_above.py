"""Objects from above: where their meshes stand on the ground, and how surely."""

from __future__ import annotations

import cv2
import numpy as np

from meshslam.geometry import Floats
from meshslam.maps import MapObject


def footprint(thing: MapObject) -> Floats:
    """Convex hull (n, 2) of an object's mesh from above, in world, metres."""
    return hull(thing.vertices_in_world[:, :2])


def hull(points: Floats) -> Floats:
    """Convex hull (n, 2) of points (m, 2)."""
    centre = points.mean(axis=0)
    found = cv2.convexHull((points - centre).astype(np.float32))
    corners: Floats = np.asarray(found, float).reshape(-1, 2) + centre
    return corners


def position_covariance(thing: MapObject) -> Floats | None:
    """Covariance (3, 3) of an object's position in world, m²."""
    if thing.pose_covariance is None:
        return None
    rotation = thing.world_from_object.rotation
    turned: Floats = rotation @ thing.pose_covariance[:3, :3] @ rotation.T
    return turned


def ellipse(covariance: Floats) -> tuple[float, float, float]:
    """Half axes, m, the longer first, and the longer one's angle from x, rad, of one sigma of a covariance in x, y."""
    values, axes = np.linalg.eigh(covariance[:2, :2])
    short, long = np.sqrt(np.maximum(values, 0)).tolist()
    return long, short, float(np.arctan2(axes[1, 1], axes[0, 1]))


def round_length_m(longest_m: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is no longer."""
    power = 10.0 ** np.floor(np.log10(longest_m))
    return float(max(step * power for step in (1, 2, 5) if step * power <= longest_m * (1 + 1e-9)))
