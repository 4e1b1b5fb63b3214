"""How well the first state and the mounting are known."""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, E, T, V, X

from meshslam.geometry import Floats, Pose
from meshslam.graph.config import StartConfig
from meshslam.motion import ImuConfig, Mounting, NavState, to_gtsam_covariance, to_pose3

ROTATION, OFFSET = E(0), T(0)  # of the mounting, one for all frames


def start_covariance(start: StartConfig, world_from_imu: Pose) -> Floats:
    """Covariance (6, 6) of the first pose, right perturbation, (translation, rotation)."""
    tilt, heading = np.radians([start.rotation_sigma_deg, start.heading_sigma_deg])
    turn = world_from_imu.rotation
    out = start.position_sigma_m**2 * np.eye(6)
    out[3:, 3:] = turn.T @ np.diag(np.square([tilt, tilt, heading])) @ turn
    return out


def start_factors(
    start: StartConfig, imu: ImuConfig, state: NavState, mounting: Mounting
) -> list[gtsam.NoiseModelFactor]:
    """Priors of the first frame's pose, velocity and biases, and of rotation and clock of the mounting."""
    noise = gtsam.noiseModel
    covariance = to_gtsam_covariance(start_covariance(start, state.world_from_imu))
    bias = gtsam.imuBias.ConstantBias(state.accelerometer_bias, state.gyroscope_bias)
    bias_sigmas = np.array([imu.accelerometer_bias_sigma_m_s2] * 3 + [imu.gyroscope_bias_sigma_rad_s] * 3)
    turn, offset = gtsam.Rot3(mounting.imu_from_camera.rotation), np.array([mounting.time_offset_s])
    turn_noise = noise.Isotropic.Sigma(3, np.radians(imu.extrinsic_rotation_sigma_deg))
    velocity_noise = noise.Isotropic.Sigma(3, start.velocity_sigma_m_s)
    return [
        gtsam.PriorFactorPose3(X(0), to_pose3(state.world_from_imu), noise.Gaussian.Covariance(covariance)),
        gtsam.PriorFactorVector(V(0), state.velocity_in_world, velocity_noise),
        gtsam.PriorFactorConstantBias(B(0), bias, noise.Diagonal.Sigmas(bias_sigmas)),
        gtsam.PriorFactorRot3(ROTATION, turn, turn_noise),
        gtsam.PriorFactorVector(OFFSET, offset, noise.Isotropic.Sigma(1, imu.time_offset_sigma_s)),
    ]
