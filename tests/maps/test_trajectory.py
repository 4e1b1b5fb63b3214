import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshslam.errors import MapError
from meshslam.geometry import Pose
from meshslam.maps import Trajectory


@pytest.fixture
def trajectory(rng):
    poses = tuple(Pose(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)) for _ in range(20))
    return Trajectory(np.arange(20) * 0.1, poses)


def test_round_trip(tmp_path, trajectory):
    trajectory.save(tmp_path / "trajectory.tum")
    loaded = Trajectory.load(tmp_path / "trajectory.tum")
    assert np.allclose(loaded.times_s, trajectory.times_s)
    for a, b in zip(loaded.world_from_camera, trajectory.world_from_camera, strict=True):
        assert np.allclose((a.inverse() @ b).matrix, np.eye(4), atol=1e-7)
    assert np.allclose(loaded.positions_in_world, [p.translation for p in trajectory.world_from_camera])
    rows = np.loadtxt(tmp_path / "trajectory.tum")
    assert np.allclose(Rotation.from_quat(rows[3, 4:]).as_matrix(), trajectory.world_from_camera[3].rotation)


def test_what_is_loaded_is_saved_as_the_same_bytes(tmp_path, trajectory):
    still = Trajectory(trajectory.times_s, tuple(Pose(np.eye(3), p.translation) for p in trajectory.world_from_camera))
    still.save(tmp_path / "a.tum")
    assert Trajectory.load(tmp_path / "a.tum").to_tum() == still.to_tum()


def test_one_time_a_pose_and_nothing_but_numbers(tmp_path, trajectory):
    with pytest.raises(MapError, match="one time a pose, found 3 and 20"):
        Trajectory(trajectory.times_s[:3], trajectory.world_from_camera)
    broken = Trajectory(np.zeros(1), (Pose(np.eye(3), np.array([0, np.nan, 0])),))
    with pytest.raises(MapError, match="holds NaN"):
        broken.save(tmp_path / "trajectory.tum")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no poses"),
        ("0 1 2\n", "line 1: expected 8 numbers"),
        ("0 0 0 0 0 0 0 nan\n", "line 1: expected finite"),
    ],
)
def test_a_bad_file_is_named(tmp_path, text, message):
    (tmp_path / "trajectory.tum").write_text(text)
    with pytest.raises(MapError, match=rf"trajectory\.tum: {message}"):
        Trajectory.load(tmp_path / "trajectory.tum")
