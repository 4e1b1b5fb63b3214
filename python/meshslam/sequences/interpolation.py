"""Poses between poses."""

from __future__ import annotations

from collections.abc import Sequence as Items

import numpy as np

from meshslam.errors import SequenceError
from meshslam.geometry import Floats, Pose


def interpolate_poses(times_s: Floats, poses: Items[Pose], at_s: Floats) -> tuple[Pose, ...]:
    """Take poses at times (n,) to other times (m,): constant velocity and angular rate between two neighbours.

    Past either end the nearest interval goes on, for half its length at most; SequenceError beyond that. One pose alone
    stands still.
    """
    if len(poses) == 1:
        return tuple(poses[0] for _ in at_s)
    steps = np.diff(times_s)
    first, last = times_s[0] - steps[0] / 2, times_s[-1] + steps[-1] / 2
    for time in at_s:
        if not first <= time <= last:
            raise SequenceError(
                f"no pose at {time:.6f} s: poses are known from {times_s[0]:.6f} s to {times_s[-1]:.6f} s"
            )
    before = np.clip(np.searchsorted(times_s, at_s, side="right") - 1, 0, len(poses) - 2)
    shares = (at_s - times_s[before]) / steps[before]
    return tuple(_between(poses[k], poses[k + 1], float(share)) for k, share in zip(before, shares, strict=True))


def _between(a: Pose, b: Pose, share: float) -> Pose:
    from scipy.spatial.transform import Rotation  # slow to import

    turn = Rotation.from_matrix(a.rotation.T @ b.rotation).as_rotvec()
    rotation = a.rotation @ Rotation.from_rotvec(share * turn).as_matrix()
    return Pose(rotation, a.translation + share * (b.translation - a.translation))
