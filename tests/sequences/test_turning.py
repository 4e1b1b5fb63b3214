"""Far points are where the homography of a turn takes them."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.sequences import ImuSamples, Sequence, turns
from tests.sequences.conftest import CAMERA, FRAMES, random_pose

TIMES_S = 0.1 * np.arange(FRAMES)
FAR_M = 1e7


@pytest.fixture
def poses(rng):
    """A camera that looks along x, and turns about z by 0.05, 0.1, ... rad."""
    level = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    return [Pose(Pose.from_yaw(0.05 * i, np.zeros(3)).rotation @ level, rng.normal(size=3)) for i in range(FRAMES)]


def recording(**known):
    return Sequence("s", "folder", ".", CAMERA, tuple(range(10, 10 + FRAMES)), TIMES_S, **known)


def moves_far_points(turn, poses):
    pixels = np.array([[20.0, 11], [40, 30], [31, 23]])
    for first, other in ((0, 1), (3, 1), (0, FRAMES - 1)):
        points = poses[first].transform(FAR_M * CAMERA.rays(pixels))
        expected = CAMERA.project(poses[other].inverse().transform(points))
        moved = np.column_stack([pixels, np.ones(3)]) @ turn(10 + first, 10 + other).T
        assert moved[:, :2] / moved[:, 2:] == pytest.approx(expected, abs=1e-2)


def test_known_poses_turn_the_camera(poses):
    moves_far_points(turns(recording(world_from_camera=tuple(poses))), poses)


def test_the_gyroscope_turns_it_where_no_pose_is_known(poses, rng):
    mounted = random_pose(rng)
    times_s = np.arange(-5, 46) * 0.01
    about_z_in_imu = mounted.rotation @ poses[0].rotation.T @ [0, 0, 0.5]
    imu = ImuSamples(times_s, np.tile(about_z_in_imu, (len(times_s), 1)), np.zeros((len(times_s), 3)))
    moves_far_points(turns(recording(imu=imu, imu_from_camera=mounted)), poses)


def test_nothing_is_said_without_poses_and_gyroscope(poses, rng):
    assert turns(recording()) is None
    imu = ImuSamples(TIMES_S, np.zeros((FRAMES, 3)), np.zeros((FRAMES, 3)))
    assert turns(recording(imu=imu)) is None
    assert turns(replace(recording(imu=imu), imu_from_camera=random_pose(rng))) is not None
