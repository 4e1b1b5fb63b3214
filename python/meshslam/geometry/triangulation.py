"""Points from pixels, and poses from points (paper, Sec. IV-C)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshslam import _core
from meshslam.errors import GeometryError
from meshslam.geometry.arrays import Floats
from meshslam.geometry.camera import Camera
from meshslam.geometry.native import floats, geometry_errors
from meshslam.geometry.pose import Pose, nearest_rotation


def triangulate(
    camera: Camera,
    world_from_camera: Sequence[Pose],
    pixels: Floats,
    sigma_px: Floats,
    cauchy: float = 2.0,
) -> tuple[Floats, Floats] | None:
    """Find the point (3,), metres, and its covariance (3, 3) from pixels (n, 2) by Levenberg-Marquardt on L_kps.

    One pose and one `sigma_px` (n,) a pixel; `cauchy` is the robust kernel's threshold in sigmas. None where the rays
    do not fix the point. GeometryError for a wrong shape, or a value that is not finite.
    """
    poses = [floats(pose.inverse().matrix) for pose in world_from_camera]
    with geometry_errors():
        found = _core.triangulate(camera, poses, floats(pixels), floats(sigma_px), cauchy)
    return None if found is None else (found[0][0], found[1])


def kabsch(points_a: Floats, points_b: Floats, weights: Floats | None = None) -> Pose:
    """The rigid a_from_b that lays points_b (n, 3) on points_a best (Kabsch 1976); n >= 3.

    `weights` (n,) are all 1 if not given. GeometryError for fewer points, or arrays of two shapes.

    >>> b = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> kabsch(b + [0.0, 0.0, 2.0], b).translation.round(9) + 0.0
    array([0., 0., 2.])
    """
    if points_a.shape != points_b.shape or len(points_a) < 3:
        raise GeometryError(
            f"Kabsch needs the same 3 or more points twice, found {points_a.shape} and {points_b.shape}"
        )
    w = np.ones(len(points_a)) if weights is None else weights
    w = w / w.sum()
    centre_a, centre_b = w @ points_a, w @ points_b
    rotation = nearest_rotation((w[:, None] * (points_a - centre_a)).T @ (points_b - centre_b))
    return Pose(rotation, centre_a - rotation @ centre_b)
