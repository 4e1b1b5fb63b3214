"""Point tracks as one factor over the cameras that observe them: the points themselves are projected out.

Each point is triangulated from the cameras; the part of its residuals that a move of the point could explain is taken
away (Mourikis and Roumeliotis 2007).
"""

from __future__ import annotations

from collections.abc import Mapping

import gtsam
import numpy as np

from meshslam.features import PointConfig, PointTracks
from meshslam.geometry import Camera, Floats, TrackedPoints
from meshslam.graph.object_factor import CameraKeys, CameraMemo
from meshslam.motion import to_gtsam_columns

_LEAST_INFORMATION = 1e-11  # of the largest


def point_factor(
    block: PointTracks,
    keys_of: Mapping[int, CameraKeys],
    memo_of: Mapping[int, CameraMemo],
    camera: Camera,
    config: PointConfig,
) -> gtsam.CustomFactor:
    """A block's tracks as one factor over its frames' X and over E and T; `keys_of` and `memo_of` go by frame.

    The velocity moves a camera by the time offset only, a few milliseconds: its derivative is left out.
    """
    frames = range(block.first, block.last + 1)
    keys = [keys_of[f][0] for f in frames] + list(keys_of[block.first][2:])
    rows = 6 * len(frames) + 1
    points = TrackedPoints(camera, block.tracks, config.sigma_px, config.kernel)

    def error(_this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        places = [memo_of[f].place(values, keys_of[f]) for f in frames]
        cameras = [place.pose for place in places]
        if jacobians is None:
            return np.append(np.zeros(rows - 1), np.sqrt(2 * points.cost(cameras)))
        found = points.normal_equations(cameras)
        by_cameras, residual = square_root(found.hessian, found.gradient, found.cost)
        by_rotation, by_offset = np.zeros((rows, 3)), np.zeros((rows, 1))
        for i, place in enumerate(places):
            by_camera = by_cameras[:, 6 * i : 6 * i + 6]
            jacobians[i] = to_gtsam_columns(by_camera @ place.by_imu)
            by_rotation += by_camera @ place.by_rotation
            by_offset += by_camera @ place.by_offset
        jacobians[-2], jacobians[-1] = np.asfortranarray(by_rotation), np.asfortranarray(by_offset)
        return residual

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(rows), keys, error)


def square_root(hessian: Floats, gradient: Floats, cost: float) -> tuple[Floats, Floats]:
    """Rows (columns + 1, columns) and residual with these normal equations, half its square being the true cost.

    Place, turn and scale of all cameras together are free: a trace of information keeps Cholesky's factor whole there.
    """
    from scipy.linalg import solve_triangular  # slow to import

    trace = _LEAST_INFORMATION * float(hessian.diagonal().max()) * np.eye(len(gradient))
    lower = np.linalg.cholesky(hessian + trace)
    residual = solve_triangular(lower, gradient, lower=True, check_finite=False)
    rest = np.sqrt(max(0.0, 2.0 * cost - float(residual @ residual)))
    rows = np.concatenate([lower.T, np.zeros((1, len(gradient)))])
    return rows, np.append(residual, rest)
