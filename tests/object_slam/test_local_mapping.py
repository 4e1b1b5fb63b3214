"""A drive that begins anywhere in a large map: its first seconds are mapped, and looked for by their cars."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from meshslam.errors import MapError, SequenceError
from meshslam.geometry import Pose
from meshslam.localization import LocalizationConfig, Localizer, RelocalizationConfig, localize_sequence, map_models
from meshslam.maps import TiledMap
from meshslam.object_slam import SlamLocalMapping
from tests.fixtures.imu_street import SOON, errors_m, stream

RELOCALIZATION = RelocalizationConfig(search_every_s=0.3, give_up_s=1.2)
CONFIG = replace(SOON, localization=LocalizationConfig(relocalization=RELOCALIZATION))
MAPPING = partial(SlamLocalMapping, config=CONFIG)


@pytest.fixture(autouse=True)
def every_map_in_tiles_is_large(monkeypatch):
    monkeypatch.setattr(map_models, "_FEW", 0)


def others(scene, first_id, place):
    """A street of the same cars in another order, elsewhere."""
    rng, cars = np.random.default_rng(first_id), list(scene.objects)
    for k in range(12):
        car, x = cars[rng.integers(len(cars))], 7.5 * (k // 2) + rng.uniform(-1, 1)
        there = Pose.from_yaw(rng.normal(0, 0.05), np.array([*place, 0.0]) + [x, 4.0 * (-1) ** k, 0.75])
        yield replace(car, id=first_id + k, world_from_object=there)


def in_tiles(folder, objects) -> TiledMap:
    city = TiledMap.create(folder)
    city.put(objects)
    return city


@pytest.fixture(scope="module")
def elsewhere(scene):
    """Streets that the drive does not pass."""
    return [car for i in range(4) for car in others(scene, 100 * (i + 1), (300.0 * (i + 1), -200.0 * i))]


@pytest.fixture(scope="module")
def city(scene, elsewhere, tmp_path_factory):
    return in_tiles(tmp_path_factory.mktemp("large") / "city", [*scene.objects, *elsewhere])


@pytest.fixture(scope="module")
def told(drive, seen):
    names = {c.name: c.keypoints for c in seen.categories}
    return {"imu_from_camera": drive.imu_from_camera, "keypoint_names": names, "config": CONFIG}


def test_a_stream_finds_itself_in_the_city(drive, seen, city, told, street):
    localizer = Localizer(drive.camera, city, **told, local_mapping=MAPPING)
    states = [localizer.process(**item) for item in stream(drive, seen)]
    first = next(i for i, s in enumerate(states) if s.is_started)
    assert 0 < first < len(states) - 1
    assert errors_m([s.world_from_camera for s in states[first:]], street.world_from_camera[first:]).max() < 0.15


def test_a_recording_without_a_start_is_localized_in_the_city(drive, seen, city, street):
    recording = replace(drive, initial_state=None, world_from_camera=None)
    given = (recording, seen, city, CONFIG.estimation, CONFIG.localization)
    found = localize_sequence(*given, make_local=MAPPING)
    assert errors_m(found.world_from_camera, street.world_from_camera).max() < 0.1


def test_where_the_street_is_not_in_the_map_it_is_said(drive, seen, elsewhere, told, tmp_path):
    city = in_tiles(tmp_path / "city", elsewhere)
    recording = replace(drive, initial_state=None, world_from_camera=None)
    given = (recording, seen, city, CONFIG.estimation, CONFIG.localization)
    with pytest.raises(SequenceError, match=r"found nowhere among the map's 48: .*; another map"):
        localize_sequence(*given, make_local=MAPPING)
    localizer = Localizer(drive.camera, city, **told, local_mapping=MAPPING)
    states = [localizer.process(**item) for item in stream(drive, seen)]
    assert not any(s.is_started for s in states)
    notes = [note for s in states for note in s.notes if "begins anew" in note]
    assert len(notes) == 1  # in 1.5 seconds, after 1.2


def test_images_that_show_something_else_refuse_a_place(drive, seen, city, told, monkeypatch):
    shown = replace(city[min(city)], vertices=city[min(city)].vertices * [0.2, 0.2, 5.0])  # no car that was seen
    poles = [replace(shown, id=n, world_from_object=city[n].world_from_object) for n in city]
    monkeypatch.setattr(TiledMap, "tile", lambda self, key: tuple(p for p in poles if self._key_of(p) == key))
    localizer = Localizer(drive.camera, city, **told, local_mapping=MAPPING)
    assert not any(localizer.process(**item).is_started for item in stream(drive, seen))


def test_what_is_missing_for_a_start_is_said(drive, seen, city, told):
    with pytest.raises(MapError, match="local_mapping="):
        Localizer(drive.camera, city, **told)
    recording = replace(drive, initial_state=None, world_from_camera=None)
    with pytest.raises(MapError, match="local_mapping="):
        localize_sequence(recording, seen, city, CONFIG.estimation, CONFIG.localization)
    Localizer(drive.camera, city, **told, start=drive.initial_state)  # nothing is looked for


def test_a_local_map_comes_once_slam_has_started(drive, seen, told):
    mapping = MAPPING(drive.camera, drive.imu_from_camera, told["keypoint_names"], "street")
    by_frame, counts = seen.by_frame(), []
    for index, frame in enumerate(drive.frame_ids):
        samples = drive.imu if index == 0 else None
        mapping.take(frame, float(drive.times_s[index]), samples, tuple(by_frame.get(frame, ())))
        local = mapping.local_map()
        counts.append(None if local is None else len(local.objects))
    assert counts[0] is None
    assert counts[-1] >= 3
