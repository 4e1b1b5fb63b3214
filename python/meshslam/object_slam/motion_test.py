"""The motion test: whether an object moves, from all of its linearized observations, without its images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats


@dataclass(frozen=True, eq=False)
class LinearView:
    """An observation's residual r + J (translation, rotation, modes); steps are in the object's frame."""

    time_s: float
    jacobian: Floats  # (n, 6 + modes)
    residual: Floats  # (n,)


def fit_velocity(views: Sequence[LinearView], world_from_object: Floats, z: Floats) -> tuple[Floats, float]:
    """Velocity (3,) in the world, m/s, that explains the observations best, and by how much the cost falls with it.

    `world_from_object` (3, 3) is a rotation. Pose and modes are free both times, the modes with their prior N(0, I):
    without that prior a car that drives nearer could not be told from a smaller one that stands.
    """
    middle = float(np.mean([view.time_s for view in views]))
    rows, right = [_prior(len(z))], [-z]
    for view in views:
        by_velocity = view.jacobian[:, :3] @ world_from_object.T * (view.time_s - middle)
        rows.append(np.hstack([view.jacobian, by_velocity]))
        right.append(-view.residual)
    matrix, target = np.concatenate(rows), np.concatenate(right)
    moving, still = _least_squares(matrix, target), _least_squares(matrix[:, :-3], target)
    gain = 0.5 * float(np.square(matrix[:, :-3] @ still - target).sum() - np.square(matrix @ moving - target).sum())
    return moving[-3:], gain


def _prior(modes: int) -> Floats:
    return np.hstack([np.zeros((modes, 6)), np.eye(modes), np.zeros((modes, 3))])


def _least_squares(matrix: Floats, target: Floats) -> Floats:
    return np.asarray(np.linalg.lstsq(matrix, target, rcond=None)[0], float)
