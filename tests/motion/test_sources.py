import dataclasses

import cv2
import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.features.two_view_motion import two_views
from meshslam.geometry import Camera, Pose, exp_so3
from meshslam.graph import Smoother, SmootherConfig, StartConfig
from meshslam.motion.config import ImuConfig, OdometryConfig
from meshslam.motion.imu import Mounting, NavState, RelativeMotion
from meshslam.motion.sources import ImageMotion, OdometryMotion
from meshslam.object_slam.start import NO_IMU
from tests.fixtures.imu_street import errors_m, slammed

CAMERA = Camera(width=1240, height=370, fx=720.0, fy=720.0, cx=610.0, cy=172.0)


def followed(rng, first_from_second, noise_px=0.2, count=150):
    points = np.column_stack([rng.uniform(-8, 8, count), rng.uniform(-3, 1.5, count), rng.uniform(8, 50, count)])
    pixels = [CAMERA.project(points), CAMERA.project(first_from_second.inverse().transform(points))]
    found = np.stack(pixels, axis=1)
    return found + rng.normal(0, noise_px, found.shape)


def test_two_views_tell_turn_and_direction():
    rng = np.random.default_rng(1)
    step = Pose(exp_so3(np.array([0.004, 0.03, -0.002])), np.array([0.05, -0.02, 1.1]))
    matches = followed(rng, step)
    matches[:15] += rng.uniform(-30, 30, (15, 2, 2))  # a tenth is wild
    found = two_views(matches, CAMERA)
    assert np.degrees(np.arccos((np.trace(found.rotation.T @ step.rotation) - 1) / 2)) < 0.1
    assert found.translation @ step.translation / np.linalg.norm(step.translation) > np.cos(np.radians(2.0))


def test_two_views_neither_use_nor_change_the_random_numbers_of_opencv():
    matches = followed(
        np.random.default_rng(1), Pose(exp_so3(np.array([0.004, 0.03, -0.002])), np.array([0.0, 0.0, 1.1]))
    )
    matches[:40] += np.random.default_rng(2).uniform(-30, 30, (40, 2, 2))
    found, drawn = [], []
    for seed in (0, 0, 5):
        cv2.setRNGSeed(seed)
        found.append(two_views(matches, CAMERA).matrix)
        drawn.append(cv2.randu(np.zeros((2, 3), np.uint8), 0, 255).tolist())
    assert all((matrix == found[0]).all() for matrix in found)
    cv2.setRNGSeed(5)
    assert drawn[2] == cv2.randu(np.zeros((2, 3), np.uint8), 0, 255).tolist()


def test_a_camera_that_stands_has_no_direction():
    rng = np.random.default_rng(2)
    turn = Pose(exp_so3(np.array([0.0, 0.02, 0.0])), np.zeros(3))
    found = two_views(followed(rng, turn, noise_px=0.05), CAMERA)
    assert np.allclose(found.translation, 0)
    assert np.allclose(found.rotation, turn.rotation, atol=1e-3)
    assert np.allclose(two_views(np.zeros((5, 2, 2)), CAMERA).matrix, np.eye(4))


def test_odometry_alone_gives_back_its_poses(street):
    poses, times = street.world_from_camera, street.times_s
    motion, zero = OdometryMotion(poses, OdometryConfig()), np.zeros(3)
    state = NavState(float(times[0]), poses[0], zero, zero, zero)
    for index in range(1, len(poses)):
        state, tie = motion.between(NO_IMU, state, float(times[index]), index)
        assert np.allclose(state.world_from_imu.matrix, poses[index].matrix)
        assert (tie.sigmas > 0).all()


@pytest.mark.parametrize("step_m", [0.0, 0.4, 3.0])
def test_odometrys_steps_are_as_uncertain_as_it_is_told(step_m):
    """A fixed part and a share of the step, independent of each other; rotations in degrees."""
    config = OdometryConfig(translation_sigma_m=0.03, translation_sigma_share=0.1, rotation_sigma_deg=2.0)
    poses = Pose.identity(), Pose(exp_so3(np.array([0.0, 0.1, 0.0])), np.array([0.0, 0.6, 0.8]) * step_m)
    zero = np.zeros(3)
    _, tie = OdometryMotion(poses, config).between(NO_IMU, NavState(0.0, poses[0], zero, zero, zero), 0.1, 1)
    sigma_m = np.sqrt(0.03**2 + (0.1 * step_m) ** 2)
    assert tie.sigmas == pytest.approx([sigma_m] * 3 + [np.radians(2.0)] * 3)
    assert np.allclose(tie.first_from_second.matrix, poses[1].matrix)


class Matches:
    """Image features that are known: the same points in every two frames."""

    def __init__(self, matches):
        self._matches = matches

    def matches(self, _):
        return self._matches


@pytest.mark.parametrize("period_s", [0.1, 0.4])
def test_a_step_by_images_is_as_uncertain_as_speed_and_turning_may_change(period_s):
    config, zero = OdometryConfig(acceleration_m_s2=2.5, turning_rad_s2=0.7), np.zeros(3)
    step = Pose(exp_so3(np.array([0.0, 0.02, 0.0])), np.array([0.0, 0.0, 1.0]))
    motion = ImageMotion(Matches(followed(np.random.default_rng(3), step)), CAMERA, config)
    state = NavState(0.0, Pose.identity(), np.array([0.0, 0.0, 6.0]), zero, zero)
    after, tie = motion.between(NO_IMU, state, period_s, 1)
    assert tie.sigmas == pytest.approx([2.5 * period_s**2] * 3 + [0.7 * period_s**2] * 3)
    assert np.linalg.norm(tie.first_from_second.translation) == pytest.approx(6.0 * period_s)
    again, _ = motion.between(NO_IMU, after, 2 * period_s, 2)  # as far as the step before
    moved = again.world_from_imu.translation - after.world_from_imu.translation
    assert np.linalg.norm(moved) == pytest.approx(6.0 * period_s)


def test_the_graph_takes_a_steps_sigmas_as_they_are():
    """Each of its own: along x, y, z and about x, y, z of the first camera."""
    exact = StartConfig(1e-6, 1e-5, 1e-5, 1e-6)
    sigmas, zero = np.array([0.1, 0.2, 0.3, 0.01, 0.02, 0.03]), np.zeros(3)
    rigid = ImuConfig(extrinsic_rotation_sigma_deg=1e-4, time_offset_sigma_s=1e-6)  # the camera is its own IMU
    smoother = Smoother(rigid, exact, SmootherConfig(), Mounting(Pose.identity()))
    state = NavState(0.0, Pose.from_yaw(0.7, np.array([3.0, 2.0, 1.0])), zero, zero, zero)
    smoother.begin(state, zero)
    step = Pose(np.eye(3), np.array([1.0, 0.0, 0.0]))
    smoother.advance(
        dataclasses.replace(state, time_s=0.1, world_from_imu=state.world_from_imu @ step),
        RelativeMotion(step, sigmas, zero),
    )
    assert np.sqrt(np.diag(smoother.cameras.pose_covariance(1))) == pytest.approx(sigmas, rel=1e-3)


@pytest.fixture(scope="module")
def reckoned(drive, street):
    """The drive without an IMU; its poses are a path that was reckoned step by step, with errors."""
    rng, poses = np.random.default_rng(8), [street.world_from_camera[0]]
    for one, other in zip(street.world_from_camera[:-1], street.world_from_camera[1:], strict=True):
        wrong = np.concatenate([rng.normal(0, 0.03, 3), rng.normal(0, 1e-3, 3)])
        poses.append(poses[-1] @ (one.inverse() @ other).retract(wrong))
    return dataclasses.replace(drive, imu=None, initial_state=None, world_from_camera=tuple(poses))


def test_objects_mend_noisy_odometry(reckoned, seen, street):
    noise = OdometryConfig(translation_sigma_m=0.03, rotation_sigma_deg=0.06)
    found = slammed(reckoned, seen, poses="odometry", odometry=noise)
    assert found.alone_by == "odometry alone"
    before, after = (
        errors_m(path, street.world_from_camera) for path in (found.alone, found.trajectory.world_from_camera)
    )
    assert np.sqrt((after**2).mean()) < 0.8 * np.sqrt((before**2).mean())
    assert np.allclose(found.trajectory.world_from_camera[0].matrix, street.world_from_camera[0].matrix, atol=0.03)


def test_without_anything_that_moves_the_camera_the_message_names_the_ways_out(reckoned, seen):
    with pytest.raises(SequenceError, match=r"--imu FILE.*--poses odometry"):
        slammed(reckoned, seen, poses="none")
    with pytest.raises(SequenceError, match="--poses odometry, but no poses are known"):
        slammed(dataclasses.replace(reckoned, world_from_camera=None), seen, poses="odometry")
