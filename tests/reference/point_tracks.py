"""The slow twin of the core's tracked points: all tracks of one length at once, points projected out row by row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import geman_mcclure_soft, hat

_MIN_DEPTH, _MAX_DEPTH = 0.05, 400.0  # of points, in units of the cameras' largest displacement
_DAMPING = 1e-9
_STEPS = 3  # of Gauss and Newton, after the midpoint of the rays


@dataclass(frozen=True, eq=False)
class Linearized:
    """Normal equations over (translation, rotation) of each camera, points projected out and weighted; true cost."""

    hessian: np.ndarray  # (6 m, 6 m)
    gradient: np.ndarray  # (6 m,)
    cost: float


def triangulate(pixels, cameras, camera):
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
    points = np.linalg.solve(normal, (across @ (eyes - eyes[0])[None, :, :, None]).sum(1))[..., 0] + eyes[0]
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

    seen: np.ndarray  # (n, m, 3), points in the cameras
    finite: np.ndarray  # (n,)
    by_point: np.ndarray  # (n, 2 m, 3)
    rest: np.ndarray  # (n, 2 m, 1), residuals with what a move of the point explains taken away
    soft: np.ndarray  # (n,), 1 + r^2 / k^2, r^2 being the residual's square per degree of freedom

    def cost(self):
        """Geman and McClure's, of all tracks."""
        return 0.5 * float(((self.rest**2).sum((1, 2)) / self.soft).sum())


def triangulated(pixels, cameras, camera, config):
    """Tracks (n, m, 2) of m cameras."""
    points, finite = triangulate(pixels, cameras, camera)
    rotations, eyes = _stacked(cameras)
    seen = _in_cameras(points, rotations, finite[:, None, None] * eyes)
    residual = ((camera.project(_before(seen)) - pixels) / config.sigma_px).reshape(len(pixels), -1)
    by_point = camera.projection_jacobian(_before(seen)) / config.sigma_px @ rotations.transpose(0, 2, 1)[None]
    by_point = by_point.reshape(len(pixels), -1, 3)
    rest = _projected_out(by_point, residual[..., None])
    soft = geman_mcclure_soft((rest**2).sum((1, 2)), (rest.shape[1] - 3) * config.kernel**2)
    return Triangulated(seen, finite, by_point, rest, soft)


def linearize(at, camera, config):
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


def _projected_out(by_point, rows):
    """(I - F (F^T F)^-1 F^T) rows: what a move of the point explains is taken away."""
    across = by_point.transpose(0, 2, 1)
    normal = across @ by_point
    normal += _DAMPING * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    rest = rows - by_point @ np.linalg.solve(normal, across @ rows)
    return rest


def _stacked(cameras):
    return np.array([c.rotation for c in cameras]), np.array([c.translation for c in cameras])


def _in_cameras(points, rotations, eyes):
    seen = np.einsum("mji,nmj->nmi", rotations, points[:, None] - eyes)
    return seen


def _before(seen):
    """The same points, no nearer than a little before the camera."""
    out = seen.copy()
    out[..., 2] = np.maximum(out[..., 2], 0.1)
    return out
