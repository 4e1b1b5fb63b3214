"""Point tracks as one factor over the cameras that observe them: the points themselves are projected out.

Each point is triangulated from the cameras; the part of its residuals that a move of the point could explain is taken
away (Mourikis and Roumeliotis 2007).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np

from meshslam.features import PointConfig, PointTracks
from meshslam.geometry import Bools, Camera, Floats, Pose, geman_mcclure_soft, hat
from meshslam.graph.object_factor import CameraKeys, CameraMemo
from meshslam.motion import to_gtsam_columns

_MIN_DEPTH, _MAX_DEPTH = 0.05, 400.0  # of points, in units of the cameras' largest displacement
_DAMPING = 1e-9
_LEAST_INFORMATION = 1e-11  # of the largest
_STEPS = 3  # of Gauss and Newton, after the midpoint of the rays


@dataclass(frozen=True, eq=False)
class Linearized:
    """Normal equations over (translation, rotation) of each camera, points projected out and weighted; true cost."""

    hessian: Floats  # (6 m, 6 m)
    gradient: Floats  # (6 m,)
    cost: float


def triangulate(pixels: Floats, cameras: Sequence[Pose], camera: Camera) -> tuple[Floats, Bools]:
    """Points (n, 3) in the world from pixels (n, m, 2), and which of them are at a finite distance.

    Of the others, whose rays are nearly parallel or do not meet, the direction in the world is returned. The limit is
    in units of the cameras' displacement, so that no scale is preferred.
    """
    rotations, eyes = _stacked(cameras)
    rays = camera.rays(pixels)
    toward = np.einsum("mij,nmj->nmi", rotations, rays / np.linalg.norm(rays, axis=2, keepdims=True))
    across = np.eye(3) - toward[..., :, None] * toward[..., None, :]
    displacement = max(float(np.linalg.norm(eyes - eyes[0], axis=1).max()), 1e-6)
    normal = across.sum(1) + _DAMPING * np.eye(3)
    points: Floats = np.linalg.solve(normal, (across @ (eyes - eyes[0])[None, :, :, None]).sum(1))[..., 0] + eyes[0]
    for _ in range(_STEPS):
        seen = _in_cameras(points, rotations, eyes[None])
        by_point = camera.projection_jacobian(_before(seen)) @ rotations.transpose(0, 2, 1)[None]
        gap = camera.project(_before(seen)) - pixels
        hessian = np.einsum("nmki,nmkj->nij", by_point, by_point)
        hessian += _DAMPING * np.trace(hessian, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        points = points - np.linalg.solve(hessian, np.einsum("nmki,nmk->ni", by_point, gap)[..., None])[..., 0]
    depth = _in_cameras(points, rotations, eyes[None])[..., 2]
    finite = np.asarray(((depth > _MIN_DEPTH * displacement) & (depth < _MAX_DEPTH * displacement)).all(1), bool)
    return np.where(finite[:, None], points, toward.mean(1)), finite


@dataclass(frozen=True, eq=False)
class Triangulated:
    """Tracks with their points, as cameras see them; whitened."""

    seen: Floats  # (n, m, 3), points in the cameras
    finite: Bools  # (n,)
    by_point: Floats  # (n, 2 m, 3)
    rest: Floats  # (n, 2 m, 1), residuals with what a move of the point explains taken away
    soft: Floats  # (n,), 1 + r^2 / k^2, r^2 being the residual's square per degree of freedom

    def cost(self) -> float:
        """Geman and McClure's, of all tracks."""
        return 0.5 * float(((self.rest**2).sum((1, 2)) / self.soft).sum())


def triangulated(pixels: Floats, cameras: Sequence[Pose], camera: Camera, config: PointConfig) -> Triangulated:
    """Tracks (n, m, 2) of m cameras."""
    points, finite = triangulate(pixels, cameras, camera)
    rotations, eyes = _stacked(cameras)
    seen = _in_cameras(points, rotations, finite[:, None, None] * eyes)
    residual = ((camera.project(_before(seen)) - pixels) / config.sigma_px).reshape(len(pixels), -1)
    by_point = camera.projection_jacobian(_before(seen)) / config.sigma_px @ rotations.transpose(0, 2, 1)[None]
    by_point = by_point.reshape(len(pixels), -1, 3)
    rest = _projected_out(by_point, residual[..., None])
    soft: Floats = geman_mcclure_soft((rest**2).sum((1, 2)), (rest.shape[1] - 3) * config.kernel**2)
    return Triangulated(seen, finite, by_point, rest, soft)


def linearize(at: Triangulated, camera: Camera, config: PointConfig) -> Linearized:
    """Normal equations of tracks, each with Geman and McClure's weight."""
    count, length = at.seen.shape[:2]
    shifted = np.broadcast_to(-np.eye(3) * at.finite[:, None, None, None], (*at.seen.shape, 3))
    moved = np.concatenate([shifted, hat(at.seen)], axis=3)
    by_camera, index = np.zeros((count, length, 2, length, 6)), np.arange(length)
    by_camera[:, index, :, index] = (camera.projection_jacobian(_before(at.seen)) / config.sigma_px @ moved).transpose(
        1, 0, 2, 3
    )
    left = _projected_out(at.by_point, by_camera.reshape(count, 2 * length, 6 * length)) / at.soft[:, None, None]
    across, right = left.transpose(0, 2, 1), at.rest / at.soft[:, None, None]
    return Linearized((across @ left).sum(0), (across @ right).sum(0)[:, 0], at.cost())


def _projected_out(by_point: Floats, rows: Floats) -> Floats:
    """(I - F (F^T F)^-1 F^T) rows: what a move of the point explains is taken away."""
    across = by_point.transpose(0, 2, 1)
    normal = across @ by_point
    normal += _DAMPING * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    rest: Floats = rows - by_point @ np.linalg.solve(normal, across @ rows)
    return rest


@dataclass
class _Last:
    """The last evaluation: GTSAM evaluates the cost, then the derivatives at the same values."""

    key: bytes = b""
    at: list[Triangulated] = field(default_factory=list)


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

    last = _Last()

    def error(_this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        places = [memo_of[f].place(values, keys_of[f]) for f in frames]
        cameras = [place.pose for place in places]
        key = b"".join(pose.matrix.tobytes() for pose in cameras)
        if key != last.key:
            last.key = key
            last.at = [triangulated(t, cameras[: t.shape[1]], camera, config) for t in block.tracks]
        cost = sum(at.cost() for at in last.at)
        if jacobians is None:
            return np.append(np.zeros(rows - 1), np.sqrt(2 * cost))
        parts = [linearize(at, camera, config) for at in last.at]
        hessian, gradient = np.zeros((rows - 1, rows - 1)), np.zeros(rows - 1)
        for part in parts:
            size = len(part.gradient)
            hessian[:size, :size] += part.hessian
            gradient[:size] += part.gradient
        by_cameras, residual = square_root(hessian, gradient, cost)
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


def _stacked(cameras: Sequence[Pose]) -> tuple[Floats, Floats]:
    return np.array([c.rotation for c in cameras]), np.array([c.translation for c in cameras])


def _in_cameras(points: Floats, rotations: Floats, eyes: Floats) -> Floats:
    seen: Floats = np.einsum("mji,nmj->nmi", rotations, points[:, None] - eyes)
    return seen


def _before(seen: Floats) -> Floats:
    """The same points, no nearer than a little before the camera."""
    out = seen.copy()
    out[..., 2] = np.maximum(out[..., 2], 0.1)
    return out
