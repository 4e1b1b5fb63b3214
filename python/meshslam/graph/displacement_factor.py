"""The distance between two cameras as a factor over the IMU's poses."""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np

from meshslam.geometry import Floats, hat
from meshslam.motion import from_pose3

_KERNEL = 6.0  # Cauchy's, in sigmas


def displacement_factor(
    keys: Sequence[int], arm_m: Floats, displacement_m: float, sigma_m: float
) -> gtsam.CustomFactor:
    """|c_j - c_i| = displacement, c = p + R arm being the camera's centre; `keys` are the two X."""

    def error(_this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        one, other = (from_pose3(values.atPose3(key)) for key in keys)
        gap = other.transform(arm_m) - one.transform(arm_m)
        length = float(np.linalg.norm(gap))
        if jacobians is not None:
            along = gap / max(length, 1e-9)
            for i, (pose, sign) in enumerate(((one, -1.0), (other, 1.0))):
                in_imu = sign * along @ pose.rotation
                jacobians[i] = np.asfortranarray(np.concatenate([-in_imu @ hat(arm_m), in_imu])[None])
        return np.array([length - displacement_m])

    noise = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Cauchy.Create(_KERNEL), gtsam.noiseModel.Isotropic.Sigma(1, sigma_m)
    )
    return gtsam.CustomFactor(noise, list(keys), error)
