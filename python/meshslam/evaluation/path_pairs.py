"""A true and an estimated path at the same times, and what lays one on the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Bools, Floats, Ints, Pose
from meshslam.maps import Trajectory

TIME_TOLERANCE_S = 5e-3


@dataclass(frozen=True, eq=False)
class Similarity:
    """A transform `a_from_b` of Sim(3): points in b are scaled, turned and moved; of SE(3) where the scale is 1."""

    scale: float
    rotation: Floats  # (3, 3)
    translation: Floats  # (3,), metres

    def transform(self, points: Floats) -> Floats:
        """Take points (..., 3), metres, from b to a."""
        moved: Floats = self.scale * points @ self.rotation.T + self.translation
        return moved

    def rigid(self) -> Pose:
        """The rotation and translation as a pose; it says nothing of the scale."""
        return Pose(self.rotation, self.translation)

    def moved(self, poses: tuple[Pose, ...]) -> tuple[Pose, ...]:
        """Poses in b as poses in a: positions are scaled, rotations turned."""
        return tuple(Pose(self.rotation @ pose.rotation, self.transform(pose.translation)) for pose in poses)


@dataclass(frozen=True, eq=False)
class PathPair:
    """True and estimated poses (world_from_camera) of the same times, and how many poses have no partner."""

    times_s: Floats  # (n,), of the true poses
    truth: tuple[Pose, ...]
    estimate: tuple[Pose, ...]
    unmatched_truth: int = 0
    unmatched_estimates: int = 0

    def __len__(self) -> int:
        return len(self.truth)

    def aligned(self, *, with_scale: bool = False) -> PathPair:
        """The same with the estimate laid on the truth by its positions, as `umeyama` does."""
        truth_from_estimate = umeyama(positions(self.truth), positions(self.estimate), with_scale=with_scale)
        moved = truth_from_estimate.moved(self.estimate)
        return PathPair(self.times_s, self.truth, moved, self.unmatched_truth, self.unmatched_estimates)


def pair_paths(truth: Trajectory, estimate: Trajectory, max_difference_s: float = TIME_TOLERANCE_S) -> PathPair:
    """Pair poses one to one: two poses belong together if each is the other's nearest in time, and near enough."""
    nearest, found = nearest_in_time(truth.times_s, estimate.times_s, max_difference_s)
    back, _ = nearest_in_time(estimate.times_s, truth.times_s, max_difference_s)
    kept = [i for i in np.flatnonzero(found).tolist() if back[nearest[i]] == i]
    return PathPair(
        truth.times_s[kept],
        tuple(truth.world_from_camera[i] for i in kept),
        tuple(estimate.world_from_camera[nearest[i]] for i in kept),
        len(truth) - len(kept),
        len(estimate) - len(kept),
    )


def nearest_in_time(
    times_s: Floats, others_s: Floats, max_difference_s: float = TIME_TOLERANCE_S
) -> tuple[Ints, Bools]:
    """For each time the index of the nearest other, and whether it is within `max_difference_s`; others increase."""
    if not len(others_s):
        return np.zeros(len(times_s), np.int64), np.zeros(len(times_s), bool)
    right = np.clip(np.searchsorted(others_s, times_s), 1, max(len(others_s) - 1, 1))
    left = right - 1
    right = np.minimum(right, len(others_s) - 1)
    nearest = np.where(times_s - others_s[left] <= others_s[right] - times_s, left, right)
    return nearest, np.abs(others_s[nearest] - times_s) <= max_difference_s


def umeyama(points_a: Floats, points_b: Floats, *, with_scale: bool) -> Similarity:
    """The a_from_b that lays points_b (n, 3) on points_a (n, 3) with the least squares (Umeyama 1991, eq. 39 to 43).

    On a straight line the turn about it is free, and any is given: distances do not depend on it.

    >>> b = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> found = umeyama(2 * b + 5, b, with_scale=True)
    >>> round(found.scale, 9), found.translation.round(9)
    (2.0, array([5., 5., 5.]))
    """
    mean_a, mean_b = points_a.mean(axis=0), points_b.mean(axis=0)
    a, b = points_a - mean_a, points_b - mean_b
    u, values, vt = np.linalg.svd(a.T @ b / len(a))
    signs = np.array([1.0, 1.0, 1.0 if np.linalg.det(u) * np.linalg.det(vt) > 0 else -1.0])
    rotation = (u * signs) @ vt
    spread = float((b**2).sum() / len(b))
    scale = float((values * signs).sum()) / spread if with_scale and spread > 0 else 1.0
    return Similarity(scale, rotation, mean_a - scale * rotation @ mean_b)


def positions(poses: tuple[Pose, ...]) -> Floats:
    """Positions (n, 3), metres."""
    return np.array([pose.translation for pose in poses]).reshape(-1, 3)


def rotations(poses: tuple[Pose, ...]) -> Floats:
    """Rotations (n, 3, 3)."""
    return np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)


def path_length_m(points: Floats) -> float:
    """Length of a path through points (n, 3)."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def distances_along_m(points: Floats) -> Floats:
    """Distance (n,) from the first point along a path through points (n, 3)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
