import dataclasses

import cv2
import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.features.two_view_motion import two_views
from meshslam.geometry import Camera, Pose, exp_so3
from meshslam.motion.config import OdometryConfig
from meshslam.motion.imu import NavState
from meshslam.motion.sources import OdometryMotion
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
