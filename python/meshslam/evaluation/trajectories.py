"""An estimated path against the true one, without alignment: both are in one world."""

from __future__ import annotations

import numpy as np

from meshslam.geometry import Bools, Floats, Ints
from meshslam.maps import Trajectory

TIME_TOLERANCE_S = 5e-3


def trajectory_figures(truth: Trajectory, estimate: Trajectory) -> dict[str, float]:
    """Root mean square and end error over the true poses that have an estimate; empty if none has.

    `ate_rmse_m`: of the camera centres (Sturm et al. 2012, without alignment). `end_error_percent`: distance at the
    last pose over the length of the true path; left out for a path that does not move.
    """
    nearest, found = nearest_in_time(truth.times_s, estimate.times_s)
    if not found.any():
        return {}
    true_path = truth.positions_in_world[found]
    errors = np.linalg.norm(true_path - estimate.positions_in_world[nearest[found]], axis=1)
    figures = {"ate_rmse_m": float(np.sqrt(np.mean(errors**2)))}
    length = path_length_m(true_path)
    if length > 0:
        figures["end_error_percent"] = float(100 * errors[-1] / length)
    return figures


def nearest_in_time(times_s: Floats, others_s: Floats) -> tuple[Ints, Bools]:
    """For each time the index of the nearest other, and whether it is within TIME_TOLERANCE_S; others increase."""
    if not len(others_s):
        return np.zeros(len(times_s), np.int64), np.zeros(len(times_s), bool)
    right = np.clip(np.searchsorted(others_s, times_s), 1, max(len(others_s) - 1, 1))
    left = right - 1
    right = np.minimum(right, len(others_s) - 1)
    nearest = np.where(times_s - others_s[left] <= others_s[right] - times_s, left, right)
    return nearest, np.abs(others_s[nearest] - times_s) <= TIME_TOLERANCE_S


def path_length_m(positions: Floats) -> float:
    """Length of a path through points (n, 3)."""
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
