"""The recording's world and the levelled one of a start that was found."""

from pathlib import Path

import numpy as np
import pytest

from meshslam.geometry import Camera, Pose, exp_so3
from meshslam.initialization import world_from_levelled
from meshslam.sequences import WORLD_FROM_FIRST_CAMERA, Sequence

CAMERA = Camera(width=640, height=200, fx=400.0, fy=400.0, cx=319.5, cy=90.0)
SEEDS = pytest.mark.parametrize("seed", range(6))


def recording(first_pose, *, is_levelled):
    """A recording of one frame."""
    poses = None if first_pose is None else (first_pose,)
    known = {"world_from_camera": poses, "is_levelled": is_levelled}
    return Sequence("one", "folder", Path("one"), CAMERA, (0,), np.zeros(1), **known)


def camera_at(rng):
    """world_from_camera in a levelled world: any place and heading, a little pitch and roll."""
    turn = Pose.from_yaw(rng.uniform(-np.pi, np.pi), rng.normal(0, 20, 3))
    return turn @ Pose(WORLD_FROM_FIRST_CAMERA.rotation @ exp_so3(rng.normal(0, 0.05, 3)), np.zeros(3))


def heading(pose):
    x, y, _ = pose.rotation[:, 2]
    return np.array([x, y]) / np.hypot(x, y)


@SEEDS
def test_a_levelled_recording_begins_where_it_is_known_to_and_heads_as_it_is_known_to(seed):
    rng = np.random.default_rng(seed)
    known, found = camera_at(rng), camera_at(rng)
    world = world_from_levelled(recording(known, is_levelled=True), found)
    assert (world @ found).translation == pytest.approx(known.translation)
    assert heading(world @ found) == pytest.approx(heading(known))


@SEEDS
def test_a_levelled_world_stays_level(seed):
    """Pitch and roll are the found ones: the IMU measures them, and up stays up."""
    rng = np.random.default_rng(seed)
    known, found = camera_at(rng), camera_at(rng)
    world = world_from_levelled(recording(known, is_levelled=True), found)
    assert world.rotation[:, 2] == pytest.approx([0, 0, 1])
    assert (world @ found).rotation[2] == pytest.approx(found.rotation[2])


@SEEDS
def test_a_world_that_is_not_level_takes_the_first_pose_whole(seed):
    rng = np.random.default_rng(seed)
    known, found = Pose(exp_so3(rng.normal(0, 1, 3)), rng.normal(0, 20, 3)), camera_at(rng)
    world = world_from_levelled(recording(known, is_levelled=False), found)
    assert np.allclose((world @ found).matrix, known.matrix)
    world = world_from_levelled(recording(None, is_levelled=False), found)
    assert np.allclose((world @ found).matrix, WORLD_FROM_FIRST_CAMERA.matrix)


def test_without_known_poses_a_levelled_world_stays_as_it_was_found(rng):
    world = world_from_levelled(recording(None, is_levelled=True), camera_at(rng))
    assert np.array_equal(world.matrix, np.eye(4))
