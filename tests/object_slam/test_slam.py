from dataclasses import replace

import numpy as np
import pytest

from meshslam.errors import MapError, SequenceError
from meshslam.object_slam import Slam, SlamConfig
from meshslam.runs import Config
from tests.fixtures.imu_street import SOON, errors_m, slammed, stream

ROUNDING = 1e-7  # the last bits of linear algebra vary with memory's alignment
QUICK = {"min_baseline_m": 2.0, "lag_s": 0.8}  # so that frames leave the window of a short drive


@pytest.fixture(scope="module")
def told(drive, seen):
    return {
        "imu_from_camera": drive.imu_from_camera,
        "start": drive.initial_state,
        "keypoint_names": seen.keypoint_names("car"),
        "height_above_ground_m": drive.height_above_ground_m,
        "config": Config(slam=SlamConfig(**QUICK)),
    }


@pytest.fixture(scope="module")
def items(drive, seen):
    return list(stream(drive, seen))


def cameras(states):
    return np.array([s.world_from_camera.matrix for s in states])


def path(slam):
    return slam.finish().trajectory.world_from_camera


def test_a_stream_gives_what_the_whole_sequence_gives(drive, seen, told, items):
    slam = Slam(drive.camera, **told)
    states = [slam.process(**item) for item in items]
    whole = slammed(drive, seen, **QUICK)
    assert errors_m([s.world_from_camera for s in states], whole.filtered).max() < 2e-3
    found = slam.finish()
    assert errors_m(found.trajectory.world_from_camera, whole.trajectory.world_from_camera).max() < 2e-3
    assert set(found.map) == set(whole.map)


def test_saved_in_the_middle_it_goes_on_here_and_there_in_the_same_way(drive, told, items, tmp_path):
    never, first = Slam(drive.camera, **told), Slam(drive.camera, **told)
    apart = [never.process(**item) for item in items]
    for item in items[:9]:
        first.process(**item)
    first.save(tmp_path / "run.npz")
    second = Slam.load(tmp_path / "run.npz", drive.camera, **told)
    here = [first.process(**item) for item in items[9:]]
    there = [second.process(**item) for item in items[9:]]
    assert cameras(here) == pytest.approx(cameras(there), abs=ROUNDING)
    assert [s.objects for s in here] == [s.objects for s in there] == [s.objects for s in apart[9:]]
    assert errors_m(path(first), path(second)).max() < ROUNDING
    assert np.linalg.norm(cameras(here)[:, :3, 3] - cameras(apart[9:])[:, :3, 3], axis=1).max() < 0.02
    assert errors_m(path(first), path(never)).max() < 0.02


def test_the_map_is_there_at_any_moment_with_covariances(drive, told, items, scene):
    slam = Slam(drive.camera, **told)
    assert len(slam.map()) == 0
    for item in items:
        slam.process(**item)
        for number, thing in slam.map().items():
            assert thing.vertices.shape == (642, 3)
            assert np.linalg.eigvalsh(thing.covariance).min() > 0
            assert number in scene
    assert len(slam.map()) >= 2
    assert np.linalg.eigvalsh(slam.camera_covariance()).min() > 0
    for number, thing in slam.map().items():
        true = scene[number].world_from_object.translation
        assert np.linalg.norm(thing.world_from_object.translation - true) < 0.6


def test_looking_at_the_map_changes_nothing(drive, told, items):
    looked, not_looked = Slam(drive.camera, **told), Slam(drive.camera, **told)
    for item in items:
        one, other = looked.process(**item), not_looked.process(**item)
        assert (one.world_from_camera.matrix == other.world_from_camera.matrix).all()
        looked.map()
        looked.camera_covariance()


def test_without_a_start_it_waits_for_the_first_seconds(drive, told, items, street):
    slam = Slam(drive.camera, **told | {"start": None, "config": replace(SOON, slam=told["config"].slam)})
    states = [slam.process(**item) for item in items]
    first = next((i for i, s in enumerate(states) if s.is_started), len(states))
    assert first > 0
    assert not any(s.is_started for s in states[:first])
    steps = (
        np.diff([p.translation for p in path(slam)], axis=0),
        np.diff([p.translation for p in street.world_from_camera], axis=0),
    )
    lengths = [np.linalg.norm(s, axis=1).sum() for s in steps]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.06)


def test_mistakes_are_said(drive, told, items, tmp_path):
    slam = Slam(drive.camera, **told)
    with pytest.raises(SequenceError, match="nothing to save"):
        slam.save(tmp_path / "run.npz")
    slam.process(**items[0])
    with pytest.raises(SequenceError, match="is not after"):
        slam.process(**items[0])
    with pytest.raises(SequenceError, match="the first had none"):
        slam.process(**items[1], image=np.zeros((180, 560, 3), np.uint8))
    (tmp_path / "other.npz").write_bytes(b"no archive")
    with pytest.raises(MapError, match=r"other\.npz"):
        Slam.load(tmp_path / "other.npz", drive.camera, **told)
    with pytest.raises(SequenceError, match="nothing tells how the camera moves"):
        Slam(drive.camera).process(time_s=0.0, detections=())
    with pytest.raises(SequenceError, match="no odometry"):
        Slam(drive.camera, by_odometry=True).process(time_s=0.0, detections=())
