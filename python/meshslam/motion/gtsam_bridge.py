"""Between this package's types and GTSAM's.

GTSAM's tangent vectors of SE(3) are (rotation, translation), ours (translation, rotation); both perturb on the right.
"""

from __future__ import annotations

import gtsam
import numpy as np

from meshslam.geometry import Floats, Pose

OURS_FROM_GTSAM = np.array([3, 4, 5, 0, 1, 2])  # it is its own inverse


def to_pose3(pose: Pose) -> gtsam.Pose3:
    """Our pose as GTSAM's; rounding that grows from product to product ends here."""
    return gtsam.Pose3(gtsam.Rot3.ClosestTo(pose.rotation), pose.translation)


def from_pose3(pose: gtsam.Pose3) -> Pose:
    """GTSAM's pose as ours."""
    return Pose(pose.rotation().matrix(), np.asarray(pose.translation(), float))


def to_gtsam_columns(jacobian: Floats) -> Floats:
    """Derivatives (n, 6) over (translation, rotation) as derivatives over (rotation, translation)."""
    return np.asfortranarray(jacobian[:, OURS_FROM_GTSAM])


def to_gtsam_covariance(covariance: Floats) -> Floats:
    """A covariance (6, 6) of (translation, rotation) as one of (rotation, translation); and back."""
    return np.ascontiguousarray(covariance[np.ix_(OURS_FROM_GTSAM, OURS_FROM_GTSAM)])
