import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.sequences.interpolation import interpolate_poses
from meshslam.sequences.report import Report
from meshslam.sequences.tum import format_tum, read_tum
from tests.sequences.conftest import random_pose


def test_known_times_give_the_known_poses(rng):
    times_s, poses = np.cumsum(rng.uniform(0.05, 0.2, 8)), [random_pose(rng) for _ in range(8)]
    for a, b in zip(interpolate_poses(times_s, poses, times_s), poses, strict=True):
        assert np.allclose(a.matrix, b.matrix, atol=1e-9)


def test_constant_motion_is_met_exactly_between_and_just_beyond(rng):
    axis, velocity = rng.normal(size=3), rng.normal(size=3)

    def at(t):
        return Pose(Rotation.from_rotvec(t * axis).as_matrix(), t * velocity)

    times_s = np.array([0.0, 0.1, 0.25, 0.3])
    wanted_s = np.append(rng.uniform(-0.05, 0.325, 30), [-0.05, 0.3249])
    for pose, time in zip(interpolate_poses(times_s, [at(t) for t in times_s], wanted_s), wanted_s, strict=True):
        assert np.allclose(pose.matrix, at(time).matrix, atol=1e-9)


@pytest.mark.parametrize("time", [-0.051, 0.26])
def test_far_beyond_is_an_error(rng, time):
    with pytest.raises(SequenceError, match="no pose at"):
        interpolate_poses(np.array([0.0, 0.1, 0.2]), [random_pose(rng) for _ in range(3)], np.array([time]))


def test_tum_round_trip_over_random_and_half_turn_poses(tmp_path, rng):
    poses = [random_pose(rng) for _ in range(50)]
    poses += [Pose(np.diag(d), np.zeros(3)) for d in ([1.0, -1, -1], [-1.0, 1, -1], [-1.0, -1, 1], [1.0, 1, 1])]
    times_s = np.arange(len(poses)) * 0.1
    path = tmp_path / "poses.tum"
    path.write_text(format_tum(times_s, poses))
    read_s, read = read_tum(path, Report())
    assert np.array_equal(read_s, np.round(times_s, 9))
    for a, b in zip(read, poses, strict=True):
        assert np.allclose(a.matrix, b.matrix, atol=1e-8)
    assert "-0.000000000" not in path.read_text()
