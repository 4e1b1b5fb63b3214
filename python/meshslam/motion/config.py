"""Settings of the IMU and of odometry."""

from __future__ import annotations

from dataclasses import dataclass

from meshslam.settings import Settings, expert, public


@dataclass(frozen=True)
class ImuConfig(Settings):
    """Noise of the IMU and of how it is mounted; densities in continuous time, defaults for KITTI's OXTS RT3003."""

    gyroscope_noise: float = public(1e-3, above=0, unit="rad/s/√Hz", doc="noise density")
    accelerometer_noise: float = public(2e-2, above=0, unit="m/s²/√Hz", doc="noise density, with the car's vibration")
    gyroscope_walk: float = public(3e-5, above=0, unit="rad/s²/√Hz", doc="noise density of the bias")
    accelerometer_walk: float = public(1e-3, above=0, unit="m/s³/√Hz", doc="noise density of the bias")
    gyroscope_bias_sigma_rad_s: float = expert(2e-3, above=0)  # at the start
    accelerometer_bias_sigma_m_s2: float = expert(3e-2, above=0)  # at the start
    gravity_m_s2: float = public(9.81, above=0, doc="along -z of the world")
    extrinsic_rotation_sigma_deg: float = expert(0.5, above=0)  # of imu_from_camera
    time_offset_sigma_s: float = expert(0.02, above=0)  # IMU clock minus camera clock
    min_rate_hz: float = expert(50.0, low=0)
    gap_periods: float = expert(5.0, low=1)  # a longer pause between two samples is a gap
    gap_accelerometer_noise: float = expert(0.7, above=0, unit="m/s²/√Hz")  # where samples are missing
    gap_gyroscope_noise: float = expert(0.05, above=0, unit="rad/s/√Hz")  # likewise


@dataclass(frozen=True)
class OdometryConfig(Settings):
    """Noise of one frame's step, where there is no IMU."""

    # of known poses that are used as odometry
    translation_sigma_m: float = expert(0.005, above=0)
    translation_sigma_share: float = expert(0.02, low=0)  # of the step
    rotation_sigma_deg: float = expert(0.05, above=0)
    # of motion that goes on evenly, where images alone tell
    acceleration_m_s2: float = expert(1.5, above=0)
    turning_rad_s2: float = expert(1.0, above=0)
