"""How well the first state and the mounting are known."""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, E, T, V

from meshslam.geometry import Floats, Pose, right_jacobian_inverse
from meshslam.graph.config import StartConfig
from meshslam.graph.object_factor import CameraKeys, CameraMemo
from meshslam.graph.records import Record, biases_record, first_camera_record, rotation_record, vector_record
from meshslam.motion import ImuConfig, Mounting, NavState, to_gtsam_columns

ROTATION, OFFSET = E(0), T(0)  # of the mounting, one for all frames


def start_covariance(start: StartConfig, world_from_first: Pose) -> Floats:
    """Covariance (6, 6) of the first pose, right perturbation, (translation, rotation)."""
    tilt, heading = np.radians([start.rotation_sigma_deg, start.heading_sigma_deg])
    turn = world_from_first.rotation
    out = start.position_sigma_m**2 * np.eye(6)
    out[3:, 3:] = turn.T @ np.diag(np.square([tilt, tilt, heading])) @ turn
    return out


def start_pose_factor(
    start: StartConfig, world_from_camera: Pose, keys: CameraKeys, memo: CameraMemo
) -> gtsam.CustomFactor:
    """The first camera stands where it is said to be."""
    given = world_from_camera

    def error(_this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        place = memo.place(values, keys)
        away = given.local(place.pose)
        if jacobians is not None:
            by_camera = np.zeros((6, 6))
            by_camera[:3, :3] = given.rotation.T @ place.pose.rotation
            by_camera[3:, 3:] = right_jacobian_inverse(away[3:])
            jacobians[0] = to_gtsam_columns(by_camera @ place.by_imu)
            jacobians[1] = np.asfortranarray(by_camera @ place.by_velocity)
            jacobians[2] = np.asfortranarray(by_camera @ place.by_rotation)
            jacobians[3] = np.asfortranarray(by_camera @ place.by_offset)
        return away

    noise = gtsam.noiseModel.Gaussian.Covariance(start_covariance(start, given))
    return gtsam.CustomFactor(noise, list(keys), error)


def start_records(
    start: StartConfig, imu: ImuConfig, state: NavState, mounting: Mounting, keys: CameraKeys
) -> list[Record]:
    """Priors of the first camera's pose, the IMU's velocity and biases, and rotation and clock of the mounting.

    What is known at the start is the camera's pose: a prior of the IMU's would leave the camera as uncertain as the
    mounting is. `keys` are the first frame's.
    """
    biases = np.concatenate([state.accelerometer_bias, state.gyroscope_bias])
    sigmas = np.array([imu.accelerometer_bias_sigma_m_s2] * 3 + [imu.gyroscope_bias_sigma_rad_s] * 3)
    turn_sigma_rad = float(np.radians(imu.extrinsic_rotation_sigma_deg))
    return [
        first_camera_record(keys, mounting.world_from_camera(state, np.zeros(3)), start),
        vector_record(V(0), state.velocity_in_world, start.velocity_sigma_m_s),
        biases_record(B(0), biases, sigmas),
        rotation_record(ROTATION, mounting.imu_from_camera.rotation, turn_sigma_rad),
        vector_record(OFFSET, np.array([mounting.time_offset_s]), imu.time_offset_sigma_s),
    ]
