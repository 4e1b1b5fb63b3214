"""Point tracks as one factor over the cameras that observe them: the points themselves are projected out.

Each point is triangulated from the cameras; the part of its residuals that a move of the point could explain is taken
away (Mourikis and Roumeliotis 2007).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import gtsam
import numpy as np

from meshslam.features import PointConfig, PointTracks
from meshslam.geometry import Camera, Floats, NormalEquations, TrackedPoints
from meshslam.graph.object_factor import CameraKeys, CameraMemo, CameraPlace
from meshslam.motion import to_gtsam_columns

_LEAST_INFORMATION = 1e-11  # of the largest


@dataclass(frozen=True, eq=False)
class PointTerm:
    """A block's tracks over its frames' X and over E and T, as its cost and normal equations: see `point_factor`."""

    points: TrackedPoints
    keys_of: tuple[CameraKeys, ...]  # by frame
    memo_of: tuple[CameraMemo, ...]

    @property
    def keys(self) -> list[int]:
        """All variables."""
        return [keys[0] for keys in self.keys_of] + list(self.keys_of[0][2:])

    def cost(self, values: gtsam.Values) -> float:
        """Half the sum of the robust squares."""
        return self.points.cost([place.pose for place in self._places(values)])

    def equations(self, values: gtsam.Values) -> NormalEquations:
        """The normal equations over the cameras, with the cost."""
        return self.points.normal_equations([place.pose for place in self._places(values)])

    def information(self, values: gtsam.Values, found: NormalEquations) -> tuple[list[int], Floats, Floats]:
        """Variables, Hessian (n, n) and gradient (n,) over steps of them, by the equations at these values."""
        places = self._places(values)
        count = len(places)
        by_variables = np.zeros((6 * count, 6 * count + 4))
        for i, place in enumerate(places):
            own = slice(6 * i, 6 * i + 6)
            by_variables[own, own] = to_gtsam_columns(place.by_imu)
            by_variables[own, -4:-1], by_variables[own, -1:] = place.by_rotation, place.by_offset
        hessian = by_variables.T @ _whole(found.hessian) @ by_variables
        return self.keys, 0.5 * (hessian + hessian.T), by_variables.T @ found.gradient

    def _places(self, values: gtsam.Values) -> list[CameraPlace]:
        return [memo.place(values, keys) for memo, keys in zip(self.memo_of, self.keys_of, strict=True)]


def point_term(
    block: PointTracks,
    keys_of: Mapping[int, CameraKeys],
    memo_of: Mapping[int, CameraMemo],
    camera: Camera,
    config: PointConfig,
) -> PointTerm:
    """A block's tracks; `keys_of` and `memo_of` go by frame."""
    frames = range(block.first, block.last + 1)
    points = TrackedPoints(camera, block.tracks, config.sigma_px, config.kernel)
    return PointTerm(points, tuple(keys_of[f] for f in frames), tuple(memo_of[f] for f in frames))


def point_factor(term: PointTerm) -> gtsam.CustomFactor:
    """A block's tracks as one factor over its frames' X and over E and T.

    The velocity moves a camera by the time offset only, a few milliseconds: its derivative is left out.
    """
    rows = 6 * len(term.keys_of) + 1

    def error(_this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        if jacobians is None:
            return np.append(np.zeros(rows - 1), np.sqrt(2 * term.cost(values)))
        places = [memo.place(values, keys) for memo, keys in zip(term.memo_of, term.keys_of, strict=True)]
        found = term.points.normal_equations([place.pose for place in places])
        by_cameras, residual = square_root(found.hessian, found.gradient, found.cost)
        by_rotation, by_offset = np.zeros((rows, 3)), np.zeros((rows, 1))
        for i, place in enumerate(places):
            by_camera = by_cameras[:, 6 * i : 6 * i + 6]
            jacobians[i] = to_gtsam_columns(by_camera @ place.by_imu)
            by_rotation += by_camera @ place.by_rotation
            by_offset += by_camera @ place.by_offset
        jacobians[-2], jacobians[-1] = np.asfortranarray(by_rotation), np.asfortranarray(by_offset)
        return residual

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(rows), term.keys, error)


def square_root(hessian: Floats, gradient: Floats, cost: float) -> tuple[Floats, Floats]:
    """Rows (columns + 1, columns) and residual with these normal equations, half its square being the true cost."""
    from scipy.linalg import solve_triangular  # slow to import

    lower = np.linalg.cholesky(_whole(hessian))
    residual = solve_triangular(lower, gradient, lower=True, check_finite=False)
    rest = np.sqrt(max(0.0, 2.0 * cost - float(residual @ residual)))
    rows = np.concatenate([lower.T, np.zeros((1, len(gradient)))])
    return rows, np.append(residual, rest)


def _whole(hessian: Floats) -> Floats:
    """The same with a trace of information, which keeps Cholesky's factor whole.

    Place, turn and scale of all cameras together are free.
    """
    trace = _LEAST_INFORMATION * float(hessian.diagonal().max())
    found: Floats = hessian + trace * np.eye(len(hessian))
    return found
