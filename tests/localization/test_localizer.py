import numpy as np
import pytest

from meshslam.errors import MapError, SequenceError
from meshslam.localization import Localizer
from tests.fixtures.imu_street import SOON, errors_m, localized, stream


@pytest.fixture(scope="module")
def told(drive, seen):
    """What a localizer is told beside camera and map."""
    names = {c.name: c.keypoints for c in seen.categories}
    return {"imu_from_camera": drive.imu_from_camera, "start": drive.initial_state, "keypoint_names": names}


def test_a_stream_gives_what_the_whole_sequence_gives(drive, seen, scene, told):
    localizer = Localizer(drive.camera, scene, **told)
    states = [localizer.process(**item) for item in stream(drive, seen)]
    whole = localized(drive, seen, scene)
    assert errors_m([s.world_from_camera for s in states], whole.filtered).max() < 2e-3
    assert all(np.linalg.eigvalsh(s.covariance).min() > 0 for s in states)


def test_without_a_start_it_waits_for_the_first_seconds_and_finds_them_in_the_map(drive, seen, scene, told, street):
    localizer = Localizer(drive.camera, scene, **told | {"start": None, "config": SOON})
    states = [localizer.process(**item) for item in stream(drive, seen)]
    first = next(i for i, s in enumerate(states) if s.is_started)
    assert not any(s.is_started for s in states[:first])
    assert errors_m([s.world_from_camera for s in states[first:]], street.world_from_camera[first:]).max() < 0.15


def test_saved_and_loaded_it_goes_on(drive, seen, scene, told, street, tmp_path):
    items = list(stream(drive, seen))
    first = Localizer(drive.camera, scene, **told)
    for item in items[:8]:
        first.process(**item)
    first.save(tmp_path / "state.npz")
    second = Localizer.load(tmp_path / "state.npz", drive.camera, scene, **told)
    states = [second.process(**item) for item in items[8:]]
    assert errors_m([s.world_from_camera for s in states], street.world_from_camera[8:]).max() < 0.1
    on = [first.process(**item) for item in items[8:]]
    gaps = errors_m([s.world_from_camera for s in states], [s.world_from_camera for s in on])
    assert gaps.max() < 1e-9


def test_mistakes_are_said(drive, seen, scene, told, tmp_path):
    localizer = Localizer(drive.camera, scene, **told)
    with pytest.raises(SequenceError, match="nothing to save"):
        localizer.save(tmp_path / "state.npz")
    item = next(stream(drive, seen))
    localizer.process(**item)
    with pytest.raises(SequenceError, match="is not after"):
        localizer.process(**item)
    (tmp_path / "other.npz").write_bytes(b"no archive")
    with pytest.raises(MapError, match=r"other\.npz"):
        Localizer.load(tmp_path / "other.npz", drive.camera, scene, **told)
