"""Settings of the IMU and of odometry."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ImuConfig:
    """Noise of the IMU and of how it is mounted; densities in continuous time, defaults for KITTI's OXTS RT3003."""

    gyroscope_noise: float = 1e-3  # rad/s/sqrt(Hz)
    accelerometer_noise: float = 2e-2  # m/s2/sqrt(Hz), vibration of the car included
    gyroscope_walk: float = 3e-5  # rad/s2/sqrt(Hz)
    accelerometer_walk: float = 1e-3  # m/s3/sqrt(Hz)
    gyroscope_bias_sigma_rad_s: float = 2e-3  # at the start
    accelerometer_bias_sigma_m_s2: float = 3e-2  # at the start
    gravity_m_s2: float = 9.81  # along -z of the world
    extrinsic_rotation_sigma_deg: float = 0.5  # of imu_from_camera
    time_offset_sigma_s: float = 0.02  # IMU clock minus camera clock
    min_rate_hz: float = 50.0
    gap_periods: float = 5.0  # a longer pause between two samples is a gap
    gap_accelerometer_noise: float = 0.7  # m/s2/sqrt(Hz), where samples are missing
    gap_gyroscope_noise: float = 0.05  # rad/s/sqrt(Hz), likewise


@dataclass(frozen=True)
class OdometryConfig:
    """Noise of one frame's step, where there is no IMU."""

    # of known poses that are used as odometry
    translation_sigma_m: float = 0.005
    translation_sigma_share: float = 0.02  # of the step
    rotation_sigma_deg: float = 0.05
    # of motion that goes on evenly, where images alone tell
    acceleration_m_s2: float = 1.5
    turning_rad_s2: float = 1.0
