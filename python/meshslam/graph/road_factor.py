"""An object's wheels on the road, as a factor over a camera's IMU and the object."""

from __future__ import annotations

import gtsam
import numpy as np

from meshslam.geometry import Floats, cross_matrix
from meshslam.motion import from_pose3


def road_factor(
    imu_key: int, object_key: int, arm_m: Floats, below_camera_m: float, sigma_m: float
) -> gtsam.CustomFactor:
    """An object's origin lies so far below a camera, which sits at `arm_m` (3,) in the IMU's frame."""

    def error(this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        x, o = this.keys()
        eye, thing = from_pose3(values.atPose3(x)), from_pose3(values.atPose3(o))
        if jacobians is not None:
            up_in_imu, up_in_object = eye.rotation[2], thing.rotation[2]
            jacobians[0] = np.asfortranarray(np.concatenate([cross_matrix(arm_m) @ up_in_imu, up_in_imu])[None])
            jacobians[1] = np.asfortranarray(np.concatenate([np.zeros(3), -up_in_object])[None])
        return np.array([eye.transform(arm_m)[2] - thing.translation[2] - below_camera_m])

    return gtsam.CustomFactor(gtsam.noiseModel.Isotropic.Sigma(1, sigma_m), [imu_key, object_key], error)
