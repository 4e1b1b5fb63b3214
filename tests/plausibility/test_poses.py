"""Poses in other conventions are named; real ones and ours are left alone."""

import numpy as np
import pytest

from meshslam.geometry import Pose, exp_so3
from meshslam.plausibility import judge_jumps, judge_mounting, judge_poses
from meshslam.sequences import CONVENTIONS, in_convention, open_sequence

WORLD_FROM_FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@pytest.fixture(scope="module")
def drive():
    """A street with a bend, driven by a camera that pitches a little."""
    rng, poses, at = np.random.default_rng(2), [], np.zeros(3)
    for k in range(60):
        heading = 0.4 + 0.01 * k + 0.004 * max(0, k - 20)
        turn = Pose.from_yaw(heading, at).rotation @ WORLD_FROM_FORWARD @ exp_so3(rng.normal(0, 0.004, 3))
        poses.append(Pose(turn, at))
        at = at + 0.9 * np.array([np.cos(heading), np.sin(heading), 0.01])
    return tuple(poses)


def as_written(poses, convention):
    """What a file of another convention gives when it is read as ours: the reverse of `in_convention`."""
    if convention == "quaternion-first":
        quaternions = [pose.to_quaternion(order="wxyz") for pose in poses]
        return tuple(
            Pose.from_quaternion(q, p.translation, order="xyzw") for q, p in zip(quaternions, poses, strict=True)
        )
    if convention == "camera-from-world":
        return tuple(pose.inverse() for pose in poses)
    back = {
        "first-camera-world": lambda p: Pose(WORLD_FROM_FORWARD.T, np.zeros(3)) @ p,
        "body": lambda p: p @ Pose(WORLD_FROM_FORWARD.T, np.zeros(3)),
    }
    return tuple(back[convention](pose) for pose in poses)


def test_ours_raise_nothing(drive):
    assert judge_poses(drive, "poses.tum") == []


@pytest.mark.parametrize("convention", CONVENTIONS[1:])
def test_another_convention_is_named_with_its_flag_and_undone(drive, convention):
    written = as_written(drive, convention)
    (found,) = judge_poses(written, "poses.tum")
    assert found.severity == "error"
    assert f"--poses-convention {convention}" in found.message
    for one, other in zip(in_convention(written, convention), drive, strict=True):
        assert np.allclose(one.matrix, other.matrix, atol=1e-9)


@pytest.mark.data
@pytest.mark.parametrize("drive_path", ["kitti_raw/2011_09_26/2011_09_26_drive_0048_sync", "kitti_odometry/06"])
def test_real_poses_raise_nothing(data_folder, drive_path):
    assert judge_poses(open_sequence(data_folder / drive_path).world_from_camera, "poses") == []


@pytest.mark.data
@pytest.mark.parametrize("drive", ["00", "06", "07"])
@pytest.mark.parametrize("frames", [17, 24])
def test_no_short_part_of_real_poses_is_refused(data_folder, drive, frames):
    rows = np.loadtxt(data_folder / "kitti_odometry" / "poses" / f"{drive}.txt").reshape(-1, 3, 4)[:1100]
    poses = [Pose(WORLD_FROM_FORWARD @ row[:, :3], row[:, 3]) for row in rows]
    parts = (tuple(poses[k : k + frames]) for k in range(0, len(poses) - frames, 10))
    assert [found.message for part in parts for found in judge_poses(part, "poses")] == []


def test_a_camera_that_is_really_tilted_is_a_note(drive):
    down = Pose(exp_so3(np.array([-1.2, 0.0, 0.0])), np.zeros(3))
    (found,) = judge_poses(tuple(p @ down for p in drive), "poses.tum")
    assert (found.code, found.severity) == ("poses_tilted", "note")


@pytest.mark.parametrize(("away_m", "severity"), [(1e25, "error"), (500.0, "error"), (30.0, "note"), (3.0, None)])
def test_a_pose_that_jumps_is_named_with_its_time(drive, away_m, severity):
    times_s = 0.1 * np.arange(len(drive))
    poses = list(drive)
    poses[3] = Pose(poses[3].rotation, poses[3].translation + [0.0, away_m, 0.0])
    found = judge_jumps(times_s, poses, "poses.tum")
    assert [f.severity for f in found] == ([severity] if severity else [])
    assert all("jumps between poses: 2, the greatest from 0." in f.message for f in found)


def test_a_path_too_short_to_tell_raises_nothing(drive):
    assert judge_poses(drive[:2], "poses.tum") == []


def test_the_mounting_is_judged_by_gravity(imu_drive):
    drive, mounted = imu_drive, imu_drive.imu_from_camera
    assert judge_mounting(drive, drive.imu, mounted, "camera.yaml") == []
    for wrong, said in ((mounted.inverse(), "invert it"), (Pose.identity(), "is the identity")):
        (found,) = judge_mounting(drive, drive.imu, wrong, "camera.yaml")
        assert said in found.message
