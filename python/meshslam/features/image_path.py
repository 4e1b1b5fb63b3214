"""A stretch of the camera's path as tracked points see it: known but for one factor of all its lengths.

Points that are tracked over three cameras fix the ratio of the two steps between them (Hartley and Zisserman 2004,
Sec. 18.1), their rotations and their directions. Given poses hold the attitude, which no image tells, and weakly the
rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from meshslam.features.point_tracks import PointConfig, PointTracks
from meshslam.geometry import Camera, Floats, Pose, TrackedPoints, hat, log_so3

_ATTITUDE_RAD = 5e-3  # sigma of each given rotation
_DIRECTION_RAD = 0.05  # of each given step's direction
_LENGTH = 0.3  # of the logarithm of each given step's length: it holds the common factor, which no point tells
_MAX_COST = 0.45  # for each degree of freedom of the points: 0.38 with their noise, real streets 0.02 to 0.13
_FIXED = 1e12
_ROUNDS, _ENOUGH, _LITTLE = 15, 1e-5, 1e-5
_DAMPING = (0.0, 1e-4, 1e-2, 1.0)  # of the diagonal


@dataclass(frozen=True, eq=False)
class ImagePath:
    """Cameras that agree with tracked points.

    The cost of logarithms x (n,) of true over given lengths is (x - log_ratios)^T information (x - log_ratios) / 2; it
    does not change with x + c.
    """

    world_from_camera: tuple[Pose, ...]  # n + 1; the common factor is that of the given ones, about
    log_ratios: Floats  # (n,) of its step lengths over the given ones
    information: Floats  # (n, n) by points alone


def step_lengths_m(world_from_camera: Sequence[Pose]) -> Floats:
    """Distances (n,) between consecutive cameras (n + 1)."""
    centres = np.array([pose.translation for pose in world_from_camera])
    return np.asarray(np.linalg.norm(np.diff(centres, axis=0), axis=1), float)


def image_path(
    camera: Camera, given: Sequence[Pose], blocks: Sequence[PointTracks], config: PointConfig
) -> ImagePath | None:
    """The path of cameras (n + 1) by point tracks, whose frames are counted from the first of them.

    None where the points do not hold every step, or do not agree within their noise. No given step may be of length 0.
    """
    terms = [
        (block.first, block.last, TrackedPoints(camera, block.tracks, config.sigma_px, config.kernel))
        for block in blocks
        if block.tracks
    ]
    held = np.zeros(len(given) - 1, bool)
    for first, last, _ in terms:
        held[first:last] = True
    if not held.all():
        return None
    problem = _Problem(tuple(given), tuple(terms), step_lengths_m(given))
    poses, hessian = problem.solved()
    freedom = sum(len(track) * (2 * track.shape[1] - 3) for block in blocks for track in block.tracks)
    if problem.point_cost(poses) > _MAX_COST * freedom:
        return None
    rows = problem.length_rows(poses)
    covariance = rows @ np.linalg.solve(hessian, rows.T)
    information = np.linalg.inv(0.5 * (covariance + covariance.T)) - np.eye(len(rows)) / _LENGTH**2
    values, vectors = np.linalg.eigh(information)
    information = (vectors * np.maximum(values, 0.0)) @ vectors.T
    ratios = np.log(step_lengths_m(poses) / problem.lengths_m)
    return ImagePath(poses, ratios, information)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Robust least squares over all cameras; points are eliminated in each term."""

    given: tuple[Pose, ...]
    terms: tuple[tuple[int, int, TrackedPoints], ...]  # first and last camera
    lengths_m: Floats

    def solved(self) -> tuple[tuple[Pose, ...], Floats]:
        """Gauss and Newton's steps, damped where the cost would rise; the cameras and the last normal matrix."""
        poses = self.given
        cost = self.cost(poses)
        for _ in range(_ROUNDS):
            hessian, gradient = self.equations(poses)
            for damping in _DAMPING:
                step = np.asarray(np.linalg.solve(hessian + damping * np.diag(hessian.diagonal()), -gradient), float)
                moved = tuple(p.retract(d) for p, d in zip(poses, step.reshape(-1, 6), strict=True))
                lower = self.cost(moved)
                if lower < cost:
                    break
            else:
                break
            is_enough = float(np.abs(step).max()) < _ENOUGH or cost - lower < _LITTLE * cost
            poses, cost = moved, lower
            if is_enough:
                break
        return poses, self.equations(poses)[0]

    def cost(self, poses: Sequence[Pose]) -> float:
        """Half the sum of squares."""
        return self.point_cost(poses) + 0.5 * sum(float(r @ r) for r, _, _ in self._given_rows(poses))

    def point_cost(self, poses: Sequence[Pose]) -> float:
        """The points' part of it."""
        return sum(term.cost(poses[first : last + 1]) for first, last, term in self.terms)

    def equations(self, poses: Sequence[Pose]) -> tuple[Floats, Floats]:
        """Normal matrix and gradient over (translation, rotation) of each camera; the first one's place is fixed."""
        size = 6 * len(poses)
        hessian, gradient = np.zeros((size, size)), np.zeros(size)
        hessian[:3, :3] += _FIXED * np.eye(3)
        for first, last, term in self.terms:
            found, at = term.normal_equations(poses[first : last + 1]), slice(6 * first, 6 * last + 6)
            hessian[at, at] += found.hessian
            gradient[at] += found.gradient
        for residual, jacobian, begin in self._given_rows(poses):
            at = slice(begin, begin + jacobian.shape[1])
            hessian[at, at] += jacobian.T @ jacobian
            gradient[at] += jacobian.T @ residual
        return hessian, gradient

    def _given_rows(self, poses: Sequence[Pose]) -> list[tuple[Floats, Floats, int]]:
        """What the given poses say: whitened residuals, their derivatives, and the column where these begin."""
        rows = []
        for k, (pose, known) in enumerate(zip(poses, self.given, strict=True)):
            turned = log_so3(known.rotation.T @ pose.rotation)
            rows.append((turned / _ATTITUDE_RAD, np.hstack([np.zeros((3, 3)), np.eye(3)]) / _ATTITUDE_RAD, 6 * k))
        for k, length in enumerate(self.lengths_m.tolist()):
            at, then = poses[k], poses[k + 1]
            known = self.given[k].rotation.T @ (self.given[k + 1].translation - self.given[k].translation) / length
            step = at.rotation.T @ (then.translation - at.translation)
            long = float(np.linalg.norm(step))
            unit = step / long
            across = (np.eye(3) - np.outer(unit, unit)) / long
            by_step = np.vstack([across / _DIRECTION_RAD, unit[None] / (long * _LENGTH)])
            zero = np.zeros((3, 3))
            moved = np.hstack([-np.eye(3), hat(step), at.rotation.T @ then.rotation, zero])
            residual = np.append((unit - known) / _DIRECTION_RAD, np.log(long / length) / _LENGTH)
            rows.append((residual, by_step @ moved, 6 * k))
        return rows

    def length_rows(self, poses: Sequence[Pose]) -> Floats:
        """Derivative (n, 6 n + 6) of the logarithms of all step lengths."""
        rows = np.zeros((len(poses) - 1, 6 * len(poses)))
        for k, (at, then) in enumerate(pairwise(poses)):
            step = then.translation - at.translation
            by_place = step / float(step @ step)
            rows[k, 6 * k : 6 * k + 3] = -by_place @ at.rotation
            rows[k, 6 * k + 6 : 6 * k + 9] = by_place @ then.rotation
        return rows
