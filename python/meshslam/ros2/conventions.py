"""Our poses, covariances and velocities in ROS' conventions (REP 103, REP 105, nav_msgs/Odometry)."""

from __future__ import annotations

import numpy as np

from meshslam.geometry import Floats, Pose

UNKNOWN_VARIANCE = 1e6  # of what is not estimated: filters that read it give it no weight


def pose_covariance_in_parent(world_from_child: Pose, covariance: Floats) -> Floats:
    """A pose's covariance (6, 6) as ROS has it, from that of a right perturbation.

    Ours is of (translation, rotation) in the child's axes: (R exp(phi), t + R rho). ROS' is of the position in the
    parent's axes and of the rotation about the parent's fixed axes: (exp(theta) R, t + x). To first order x = R rho and
    theta = R phi. Metres and radians.

    >>> turned = Pose.from_yaw(np.pi / 2, np.zeros(3))
    >>> np.diag(pose_covariance_in_parent(turned, np.diag([1.0, 4.0, 9.0, 1.0, 4.0, 9.0]))).round(9)
    array([4., 1., 9., 4., 1., 9.])
    """
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = world_from_child.rotation
    turned: Floats = turn @ covariance @ turn.T
    return (turned + turned.T) / 2


def covariance_of_body(covariance: Floats, camera_from_body: Pose) -> Floats:
    """A right perturbation's covariance (6, 6) of world_from_body, from that of world_from_camera.

    Exp(d) C = C Exp(Ad(C^-1) d) with C = camera_from_body.
    """
    adjoint = camera_from_body.inverse().adjoint()
    moved: Floats = adjoint @ covariance @ adjoint.T
    return moved


def twist_in_child(
    world_from_imu: Pose, velocity_in_world: Floats, rate_in_imu: Floats, imu_from_child: Pose
) -> tuple[Floats, Floats]:
    """Linear and angular velocity (3,) each of a frame on the body, in its own axes, m/s and rad/s.

    `velocity_in_world` is that of the IMU, `rate_in_imu` its angular rate: the child also moves by the lever arm.
    """
    lever = np.cross(rate_in_imu, imu_from_child.translation)
    in_imu = world_from_imu.rotation.T @ velocity_in_world + lever
    child_from_imu = imu_from_child.rotation.T
    linear, angular = child_from_imu @ in_imu, child_from_imu @ rate_in_imu
    return linear, angular
