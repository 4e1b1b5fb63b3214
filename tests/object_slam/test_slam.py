import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import MapError, SequenceError
from meshslam.localization.config import LocalizationConfig
from meshslam.object_slam import Slam, SlamConfig, SlamSettings, slam_path
from meshslam.objects import MappingConfig
from tests.fixtures.imu_street import errors_m
from tests.localization.test_localizer import stream

ROUNDING = 1e-7  # the last bits of linear algebra vary with memory's alignment
QUICK = SlamConfig(min_baseline_m=2.0, lag_s=0.8)  # so that frames leave the window of a short drive


@pytest.fixture(scope="module")
def config(drive, seen):
    names, height = seen.keypoint_names("car"), drive.height_above_ground_m
    category = load_category("car")
    return SlamSettings(drive.camera, drive.imu_from_camera, category, drive.initial_state, names, height, slam=QUICK)


@pytest.fixture(scope="module")
def items(drive, seen):
    return list(stream(drive, seen))


def cameras(states):
    return np.array([s.world_from_camera.matrix for s in states])


def test_a_stream_gives_what_the_whole_sequence_gives(drive, seen, config, items):
    system = Slam(config)
    states = [system.process(*item) for item in items]
    whole = slam_path(drive, seen, load_category("car"), LocalizationConfig(), QUICK, MappingConfig())
    assert errors_m([s.world_from_camera for s in states], whole.filtered).max() < 2e-3
    assert errors_m(system.finish().world_from_camera, whole.world_from_camera).max() < 2e-3


def test_saved_in_the_middle_it_goes_on_here_and_there_in_the_same_way(config, items, tmp_path):
    never, first = Slam(config), Slam(config)
    apart = [never.process(*item) for item in items]
    for item in items[:9]:
        first.process(*item)
    first.save(tmp_path / "run.npz")
    second = Slam.load(tmp_path / "run.npz", config)
    here = [first.process(*item) for item in items[9:]]
    there = [second.process(*item) for item in items[9:]]
    assert cameras(here) == pytest.approx(cameras(there), abs=ROUNDING)
    assert [s.objects for s in here] == [s.objects for s in there] == [s.objects for s in apart[9:]]
    one, other = first.finish().world_from_camera, second.finish().world_from_camera
    assert errors_m(one, other).max() < ROUNDING
    assert np.linalg.norm(cameras(here)[:, :3, 3] - cameras(apart[9:])[:, :3, 3], axis=1).max() < 0.02
    assert errors_m(one, never.finish().world_from_camera).max() < 0.02


def test_mistakes_are_said(config, items, tmp_path):
    system = Slam(config)
    with pytest.raises(SequenceError, match="nothing to save"):
        system.save(tmp_path / "run.npz")
    system.process(*items[0])
    with pytest.raises(SequenceError, match="is not after"):
        system.process(*items[0])
    (tmp_path / "other.npz").write_bytes(b"no archive")
    with pytest.raises(MapError, match=r"other\.npz"):
        Slam.load(tmp_path / "other.npz", config)
