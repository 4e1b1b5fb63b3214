"""Poses, covariances and velocities as ROS has them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshslam.geometry import Pose
from meshslam.ros2.conventions import covariance_of_body, pose_covariance_in_parent, twist_in_child


def random_pose(rng):
    return Pose.exp(np.concatenate([rng.normal(0, 5, 3), rng.normal(0, 1, 3)]))


def random_covariance(rng, scale):
    half = rng.normal(0, scale, (6, 6))
    return half @ half.T


def in_parent(pose, moved):
    """Displacement of the position, and rotation about the parent's fixed axes: what ROS' covariance is of."""
    turn = Rotation.from_matrix(moved.rotation @ pose.rotation.T)
    return np.concatenate([moved.translation - pose.translation, turn.as_euler("xyz")])  # small: fixed axes x, y, z


def test_the_covariance_is_that_of_position_and_fixed_axes_by_finite_differences(rng):
    step = 1e-6
    for _ in range(20):
        pose, covariance = random_pose(rng), random_covariance(rng, 1.0)
        columns = [
            in_parent(pose, pose.retract(step * d)) - in_parent(pose, pose.retract(-step * d)) for d in np.eye(6)
        ]
        jacobian = np.array(columns).T / (2 * step)
        expected = jacobian @ covariance @ jacobian.T
        np.testing.assert_allclose(pose_covariance_in_parent(pose, covariance), expected, atol=1e-6)


def test_the_covariance_is_that_of_samples(rng):
    pose, covariance = random_pose(rng), random_covariance(rng, 0.005)
    steps = rng.multivariate_normal(np.zeros(6), covariance, 4_000)
    seen = np.array([in_parent(pose, pose.retract(step)) for step in steps])
    told = pose_covariance_in_parent(pose, covariance)
    sigmas = np.sqrt(told.diagonal())
    np.testing.assert_allclose(np.cov(seen.T) / np.outer(sigmas, sigmas), told / np.outer(sigmas, sigmas), atol=0.08)


def test_a_turned_camera_swaps_its_axes():
    """Uncertain ahead (the camera's z) is uncertain along the world's x, where the camera looks along x."""
    forward = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    told = pose_covariance_in_parent(Pose(forward, np.array([5.0, 6.0, 7.0])), np.diag([1.0, 2.0, 9.0, 1.0, 2.0, 9.0]))
    np.testing.assert_allclose(told, np.diag([9.0, 1.0, 2.0, 9.0, 1.0, 2.0]), atol=1e-12)


def test_the_covariance_of_the_body_by_finite_differences(rng):
    step = 1e-6
    for _ in range(20):
        camera, mounted, covariance = random_pose(rng), random_pose(rng), random_covariance(rng, 1.0)
        body = camera @ mounted
        columns = [
            body.local(camera.retract(step * d) @ mounted) - body.local(camera.retract(-step * d) @ mounted)
            for d in np.eye(6)
        ]
        jacobian = np.array(columns).T / (2 * step)
        np.testing.assert_allclose(
            covariance_of_body(covariance, mounted), jacobian @ covariance @ jacobian.T, rtol=1e-5, atol=1e-5
        )


def test_the_twist_is_the_childs_motion_by_finite_differences(rng):
    for _ in range(20):
        start, imu_from_child = random_pose(rng), random_pose(rng)
        velocity, rate = rng.normal(0, 5, 3), rng.normal(0, 1, 3)

        def imu_at(t, start=start, velocity=velocity, rate=rate):
            turn = Pose.exp(np.concatenate([np.zeros(3), t * rate])).rotation
            return Pose(start.rotation @ turn, start.translation + t * velocity)

        step = 1e-6
        before, now, after = (imu_at(t) @ imu_from_child for t in (-step, 0.0, step))
        moved = now.local(after) - now.local(before)
        linear, angular = twist_in_child(start, velocity, rate, imu_from_child)
        np.testing.assert_allclose(linear, moved[:3] / (2 * step), atol=1e-5)
        np.testing.assert_allclose(angular, moved[3:] / (2 * step), atol=1e-5)


@pytest.mark.parametrize("scale", [1e-12, 1e6])
def test_the_covariance_stays_symmetric(rng, scale):
    told = pose_covariance_in_parent(random_pose(rng), scale * random_covariance(rng, 1.0))
    np.testing.assert_array_equal(told, told.T)
