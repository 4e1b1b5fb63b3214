"""Tracks of corners as one factor over the cameras that saw them: the points themselves are projected out.

Each point is triangulated from the cameras; the part of its residuals that a move of the point could explain is taken
away (Mourikis and Roumeliotis 2007).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from meshslam.geometry import Camera, Pose
from meshslam.geometry.arrays import Bools, Floats
from meshslam.localization.factors import CameraKeys, CameraMemo
from meshslam.localization.gtsam_bridge import to_gtsam_columns
from meshslam.localization.point_tracks import PointBlock, PointConfig

_NEAREST_M, _FARTHEST_M = 1.0, 200.0
_STEPS = 3  # of Gauss and Newton, after the midpoint of the rays


@dataclass(frozen=True, eq=False)
class Linearized:
    """Rows over (translation, rotation) of each camera, whitened, points projected out, weighted; and the true cost."""

    jacobian: Floats  # (r, 6 m)
    residual: Floats  # (r,)
    cost: float


def triangulate(pixels: Floats, cameras: Sequence[Pose], camera: Camera) -> tuple[Floats, Bools]:
    """Points (n, 3) in the world from pixels (n, m, 2), and which of them have a depth.

    The others are put far away on their first ray: they still tell how the camera turns.
    """
    rotations, eyes = _stacked(cameras)
    rays = camera.rays(pixels)
    toward = np.einsum("mij,nmj->nmi", rotations, rays / np.linalg.norm(rays, axis=2, keepdims=True))
    across = np.eye(3) - toward[..., :, None] * toward[..., None, :]
    normal = across.sum(1) + 1e-12 * np.eye(3)
    points: Floats = np.linalg.solve(normal, (across @ eyes[None, :, :, None]).sum(1))[..., 0]
    for _ in range(_STEPS):
        seen = _in_cameras(points, rotations, eyes)
        by_point = _projection(seen, camera) @ rotations.transpose(0, 2, 1)[None]
        gap = camera.project(_before(seen)) - pixels
        hessian = np.einsum("nmki,nmkj->nij", by_point, by_point) + 1e-9 * np.eye(3)
        points = points - np.linalg.solve(hessian, np.einsum("nmki,nmk->ni", by_point, gap)[..., None])[..., 0]
    depth = _in_cameras(points, rotations, eyes)[..., 2]
    sound = np.asarray(((depth > _NEAREST_M) & (depth < _FARTHEST_M)).all(1), bool)
    return np.where(sound[:, None], points, eyes[0] + _FARTHEST_M * toward[:, 0]), sound


def linearize(pixels: Floats, cameras: Sequence[Pose], camera: Camera, config: PointConfig) -> Linearized:
    """Tracks (n, m, 2) of m cameras, each with Geman and McClure's weight."""
    rotations, eyes = _stacked(cameras)
    points, _ = triangulate(pixels, cameras, camera)
    count, length = pixels.shape[:2]
    seen = _in_cameras(points, rotations, eyes)
    by_seen = _projection(seen, camera) / config.sigma_px
    residual = ((camera.project(_before(seen)) - pixels) / config.sigma_px).reshape(count, -1)
    by_point = (by_seen @ rotations.transpose(0, 2, 1)[None]).reshape(count, -1, 3)
    by_camera = np.zeros((count, length, 2, length, 6))
    index = np.arange(length)
    moved = np.concatenate([np.broadcast_to(-np.eye(3), (*seen.shape, 3)), _hats(seen)], axis=3)
    by_camera[:, index, :, index] = (by_seen @ moved).transpose(1, 0, 2, 3)
    rows = by_camera.reshape(count, 2 * length, 6 * length)
    basis = np.linalg.qr(by_point, mode="complete").Q[:, :, 3:].transpose(0, 2, 1)
    left, right = basis @ rows, (basis @ residual[..., None])[..., 0]
    freedom = right.shape[1]
    squared = (right**2).sum(1)
    soft = 1.0 + squared / (freedom * config.kernel**2)
    cost = 0.5 * float((squared / soft).sum())
    return Linearized((left / soft[:, None, None]).reshape(-1, 6 * length), (right / soft[:, None]).ravel(), cost)


def point_factor(
    block: PointBlock,
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

    def error(_this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        places = [memo_of[f].place(values, keys_of[f]) for f in frames]
        parts = [linearize(t, [p.pose for p in places[: t.shape[1]]], camera, config) for t in block.tracks]
        cost = sum(part.cost for part in parts)
        if jacobians is None:
            return np.append(np.zeros(rows - 1), np.sqrt(2 * cost))
        wide = [np.pad(part.jacobian, ((0, 0), (0, rows - 1 - part.jacobian.shape[1]))) for part in parts]
        by_cameras, residual = square_root(np.concatenate(wide), np.concatenate([p.residual for p in parts]), cost)
        by_rotation, by_offset = np.zeros((rows, 3)), np.zeros((rows, 1))
        for i, place in enumerate(places):
            by_camera = by_cameras[:, 6 * i : 6 * i + 6]
            jacobians[i] = to_gtsam_columns(by_camera @ place.by_imu)
            by_rotation += by_camera @ place.by_rotation
            by_offset += by_camera @ place.by_offset
        jacobians[-2], jacobians[-1] = np.asfortranarray(by_rotation), np.asfortranarray(by_offset)
        return residual

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(rows), keys, error)


def square_root(jacobian: Floats, residual: Floats, cost: float) -> tuple[Floats, Floats]:
    """At most columns + 1 rows with the same normal equations, whose half squared residual is the true cost."""
    columns = jacobian.shape[1]
    both = np.concatenate([jacobian, residual[:, None]], axis=1)
    upper = np.linalg.qr(both, mode="r") if len(both) > columns + 1 else both
    rows = np.zeros((columns + 1, columns + 1))
    rows[: min(len(upper), columns + 1)] = upper[: columns + 1]
    head = rows[:-1, -1]
    rows[-1, :-1] = 0.0
    rows[-1, -1] = np.sqrt(max(0.0, 2.0 * cost - float(head @ head)))
    return rows[:, :-1], rows[:, -1]


def _stacked(cameras: Sequence[Pose]) -> tuple[Floats, Floats]:
    return np.array([c.rotation for c in cameras]), np.array([c.translation for c in cameras])


def _in_cameras(points: Floats, rotations: Floats, eyes: Floats) -> Floats:
    seen: Floats = np.einsum("mji,nmj->nmi", rotations, points[:, None] - eyes[None])
    return seen


def _before(seen: Floats) -> Floats:
    """The same points, no nearer than a little before the camera."""
    out = seen.copy()
    out[..., 2] = np.maximum(out[..., 2], 0.1)
    return out


def _projection(seen: Floats, camera: Camera) -> Floats:
    """Derivative (n, m, 2, 3) of pixels over points in the camera."""
    x, y, z = np.moveaxis(_before(seen), -1, 0)
    out = np.zeros((*seen.shape[:2], 2, 3))
    out[..., 0, 0], out[..., 0, 1] = camera.fx / z, camera.skew / z
    out[..., 0, 2] = -(camera.fx * x + camera.skew * y) / z**2
    out[..., 1, 1], out[..., 1, 2] = camera.fy / z, -camera.fy * y / z**2
    return out


def _hats(vectors: Floats) -> Floats:
    """Cross product matrices (..., 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*vectors.shape, 3)
