"""An estimated path against the true one: absolute and relative errors (Sturm et al. 2012)."""

from __future__ import annotations

import numpy as np

from meshslam.evaluation.path_pairs import PathPair, distances_along_m, pair_paths, path_length_m, positions, rotations
from meshslam.geometry import Floats, Ints
from meshslam.maps import Trajectory

METRES_TOLERANCE = 0.1  # of the distance, by which a pair of RPE over metres may be longer or shorter; as evo has it


def trajectory_figures(truth: Trajectory, estimate: Trajectory) -> dict[str, float]:
    """The figures of metrics.json, without alignment: both paths are in one world; empty if no times are shared.

    `ate_rmse_m`: of the camera centres (Sturm et al. 2012). `end_error_percent`: distance at the last pose over the
    length of the true path; left out for a path that does not move.
    """
    pair = pair_paths(truth, estimate)
    if not len(pair):
        return {}
    return {"ate_rmse_m": root_mean_square(absolute_errors_m(pair))} | end_error(pair)


def absolute_errors_m(pair: PathPair) -> Floats:
    """Distance (n,) of each estimated camera centre from the true one, metres."""
    found: Floats = np.linalg.norm(positions(pair.truth) - positions(pair.estimate), axis=1)
    return found


def absolute_rotation_errors_rad(pair: PathPair) -> Floats:
    """Angle (n,) between each estimated and true rotation."""
    return angles_rad(rotations(pair.truth).transpose(0, 2, 1) @ rotations(pair.estimate))


def end_error(pair: PathPair) -> dict[str, float]:
    """`end_error_percent`; empty for a path that does not move."""
    length_m = path_length_m(positions(pair.truth))
    return {"end_error_percent": float(100 * absolute_errors_m(pair)[-1] / length_m)} if length_m > 0 else {}


def relative_errors(pair: PathPair, first: Ints, last: Ints) -> tuple[Floats, Floats]:
    """Errors of the motions from poses `first` to poses `last`: metres (m,), radians (m,).

    E = (Q_i⁻¹ Q_j)⁻¹ (P_i⁻¹ P_j), Q true and P estimated (Sturm et al. 2012, eq. 1).
    """
    true_turn, true_step = _motions(rotations(pair.truth), positions(pair.truth), first, last)
    turn, step = _motions(rotations(pair.estimate), positions(pair.estimate), first, last)
    back = true_turn.transpose(0, 2, 1)
    return np.linalg.norm(step - true_step, axis=1), angles_rad(back @ turn)


def frame_pairs(count: int, delta: int) -> tuple[Ints, Ints]:
    """Every pair of poses that are `delta` frames apart."""
    first = np.arange(max(count - delta, 0))
    return first, first + delta


def metre_pairs(truth: Floats, delta_m: float) -> tuple[Ints, Ints]:
    """From each true position (n, 3) to that nearest to `delta_m` further on; left out where it is 10% off."""
    along = distances_along_m(truth)
    first = np.arange(len(along) - 1)
    after = np.clip(np.searchsorted(along, along[first] + delta_m), first + 1, len(along) - 1)
    before = np.maximum(after - 1, first + 1)
    before = np.maximum(np.searchsorted(along, along[before]), first + 1)  # of those that stand there, the first
    gaps = [np.abs(along[last] - along[first] - delta_m) for last in (before, after)]
    last = np.where(gaps[0] <= gaps[1], before, after)
    kept = np.minimum(*gaps) <= METRES_TOLERANCE * delta_m
    return first[kept], last[kept]


def angles_rad(turns: Floats) -> Floats:
    """Angle (n,) of rotations (n, 3, 3), from 0 to pi, exact near both ends."""
    skew = turns - turns.transpose(0, 2, 1)
    sine = np.sqrt(skew[:, 2, 1] ** 2 + skew[:, 0, 2] ** 2 + skew[:, 1, 0] ** 2) / 2
    angles: Floats = np.arctan2(sine, (np.trace(turns, axis1=1, axis2=2) - 1) / 2)
    return angles


def root_mean_square(errors: Floats) -> float:
    """Root of the mean square of errors (n,)."""
    return float(np.sqrt(np.mean(errors**2)))


def _motions(turns: Floats, places: Floats, first: Ints, last: Ints) -> tuple[Floats, Floats]:
    """Rotations (m, 3, 3) and translations (m, 3) of poses `last` as the poses `first` see them."""
    back = turns[first].transpose(0, 2, 1)
    steps: Floats = np.einsum("nij,nj->ni", back, places[last] - places[first])
    return back @ turns[last], steps
