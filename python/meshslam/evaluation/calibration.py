"""Whether said uncertainties are as large as the errors: shares inside regions, and NEES (Bar-Shalom et al. 2001)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.evaluation.path_pairs import TIME_TOLERANCE_S, nearest_in_time
from meshslam.geometry import Floats, Pose
from meshslam.maps import MapObject, Trajectory, TrajectoryEstimate

SHARES = (0.6827, 0.95)  # of a right normal distribution: that within one sigma, and 95%
_NO_VARIANCE = 1e-16  # m^2, rad^2: of a pose that others are relative to


@dataclass(frozen=True, eq=False)
class Calibration:
    """Squared errors over what is said of them; of right covariances they follow chi-square of `dimension`."""

    squares: Floats  # (n,), e^T C^-1 e
    dimension: int

    def figures(self, name: str) -> dict[str, float]:
        """`NAME_within_68`, `NAME_within_95` and `NAME_nees`, the mean over the dimension: 1 where C is right."""
        from scipy.stats import chi2

        if not len(self.squares):
            return {}
        inside = [float((self.squares <= chi2.ppf(share, self.dimension)).mean()) for share in SHARES]
        nees = float(self.squares.mean() / self.dimension)
        return {f"{name}_within_68": inside[0], f"{name}_within_95": inside[1], f"{name}_nees": nees}


def object_calibration(pairs: Sequence[tuple[MapObject, MapObject]]) -> Calibration:
    """Of the positions of matched objects (true, estimated) that have a covariance."""
    squares = []
    for true, found in pairs:
        if found.pose_covariance is not None:
            gap = found.world_from_object.rotation.T @ (
                true.world_from_object.translation - found.world_from_object.translation
            )
            squares.append(_square(gap, found.pose_covariance[:3, :3]))
    return Calibration(np.array(squares), 3)


def path_calibration(
    truth: Trajectory, estimate: TrajectoryEstimate, max_difference_s: float = TIME_TOLERANCE_S
) -> dict[str, Calibration]:
    """Of `camera_pose` (6), `camera_position` and `camera_rotation` (3 each), at the poses that have a true one.

    A pose without variance lays the world, and is left out. The error is e in true = estimate.retract(e), that which
    the covariance is of.
    """
    nearest, found = nearest_in_time(estimate.trajectory.times_s, truth.times_s, max_difference_s)
    kept = [i for i in np.flatnonzero(found).tolist() if np.diag(estimate.covariances[i]).min() > _NO_VARIANCE]
    errors = [_error(estimate.trajectory.world_from_camera[i], truth.world_from_camera[nearest[i]]) for i in kept]
    parts = {"camera_pose": slice(0, 6), "camera_position": slice(0, 3), "camera_rotation": slice(3, 6)}
    return {
        name: Calibration(
            np.array(
                [_square(e[part], estimate.covariances[i][part, part]) for i, e in zip(kept, errors, strict=True)]
            ),
            part.stop - part.start,
        )
        for name, part in parts.items()
    }


def _error(estimate: Pose, truth: Pose) -> Floats:
    return estimate.local(truth)


def _square(error: Floats, covariance: Floats) -> float:
    return float(error @ np.linalg.solve(covariance, error))
