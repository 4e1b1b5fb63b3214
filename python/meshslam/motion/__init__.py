"""IMU samples, preintegration, states and what moves the camera from frame to frame."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.motion.config import ImuConfig, OdometryConfig
    from meshslam.motion.gtsam_bridge import (
        OURS_FROM_GTSAM,
        from_pose3,
        to_gtsam_columns,
        to_gtsam_covariance,
        to_pose3,
    )
    from meshslam.motion.imu import (
        ImuNoise,
        Interval,
        Mounting,
        NavState,
        Preintegrator,
        Readings,
        RelativeMotion,
        check_imu,
        mean_specific_force,
        predict,
        rate_at,
        sample_rate_hz,
        state_of_camera,
    )
    from meshslam.motion.imu_buffer import ImuBuffer
    from meshslam.motion.inertial_odometry import first_velocity, inertial_path, start_state
    from meshslam.motion.sources import ImageMotion, ImuMotion, MotionSource, OdometryMotion
else:
    __getattr__ = deferred(
        __name__,
        {
            "config": "ImuConfig OdometryConfig",
            "gtsam_bridge": "OURS_FROM_GTSAM from_pose3 to_gtsam_columns to_gtsam_covariance to_pose3",
            "imu": (
                "ImuNoise Interval Mounting NavState Preintegrator Readings RelativeMotion check_imu "
                "mean_specific_force predict rate_at sample_rate_hz state_of_camera"
            ),
            "imu_buffer": "ImuBuffer",
            "inertial_odometry": "first_velocity inertial_path start_state",
            "sources": "ImageMotion ImuMotion MotionSource OdometryMotion",
        },
    )

__all__ = [
    "OURS_FROM_GTSAM",
    "ImageMotion",
    "ImuBuffer",
    "ImuConfig",
    "ImuMotion",
    "ImuNoise",
    "Interval",
    "MotionSource",
    "Mounting",
    "NavState",
    "OdometryConfig",
    "OdometryMotion",
    "Preintegrator",
    "Readings",
    "RelativeMotion",
    "check_imu",
    "first_velocity",
    "from_pose3",
    "inertial_path",
    "mean_specific_force",
    "predict",
    "rate_at",
    "sample_rate_hz",
    "start_state",
    "state_of_camera",
    "to_gtsam_columns",
    "to_gtsam_covariance",
    "to_pose3",
]
