import numpy as np
import pytest

from meshslam.errors import MapError, SequenceError
from meshslam.localization import Frame, LocalizationConfig, Localizer, LocalizerSettings, localize
from meshslam.sequences import ImuSamples
from tests.fixtures.imu_street import errors_m


@pytest.fixture(scope="module")
def config(drive, seen, scene):
    names = {c.name: c.keypoints for c in seen.categories}
    settings = LocalizationConfig()
    return LocalizerSettings(drive.camera, drive.imu_from_camera, scene, drive.initial_state, names, settings)


def stream(drive, seen):
    """Frames with the samples since the frame before."""
    by_frame, imu, last = seen.by_frame(), drive.imu, -np.inf
    for index, frame in enumerate(drive.frame_ids):
        now = float(drive.times_s[index])
        new = (imu.times_s > last) & (imu.times_s <= now + 0.011)
        last = float(imu.times_s[new][-1])
        samples = ImuSamples(imu.times_s[new], imu.angular_rate_rad_s[new], imu.specific_force_m_s2[new])
        yield Frame(frame, now, by_frame[frame]), samples


def test_a_stream_gives_what_the_whole_sequence_gives(drive, seen, scene, config):
    system = Localizer(config)
    states = [system.process(*item) for item in stream(drive, seen)]
    whole = localize(drive, seen, scene, LocalizationConfig())
    assert errors_m([s.world_from_camera for s in states], whole.filtered).max() < 2e-3
    assert all(np.linalg.eigvalsh(s.covariance).min() > 0 for s in states)


def test_saved_and_loaded_it_goes_on(drive, seen, config, street, tmp_path):
    items = list(stream(drive, seen))
    first = Localizer(config)
    for item in items[:8]:
        first.process(*item)
    first.save(tmp_path / "state.npz")
    second = Localizer.load(tmp_path / "state.npz", config)
    states = [second.process(*item) for item in items[8:]]
    assert errors_m([s.world_from_camera for s in states], street.world_from_camera[8:]).max() < 0.1
    on = [first.process(*item) for item in items[8:]]
    gaps = errors_m([s.world_from_camera for s in states], [s.world_from_camera for s in on])
    assert gaps.max() < 5e-3


def test_mistakes_are_said(drive, seen, config, tmp_path):
    system = Localizer(config)
    with pytest.raises(SequenceError, match="nothing to save"):
        system.save(tmp_path / "state.npz")
    item = next(stream(drive, seen))
    system.process(*item)
    with pytest.raises(SequenceError, match="is not after"):
        system.process(*item)
    (tmp_path / "other.npz").write_bytes(b"no archive")
    with pytest.raises(MapError, match=r"other\.npz"):
        Localizer.load(tmp_path / "other.npz", config)
