"""What the place of a local map says of the first frame."""

from types import SimpleNamespace

import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.localization import LocalMap, RelocalizationConfig
from meshslam.localization.local_mapping import PlaceSearch, moved_state
from meshslam.maps import Constellation, ConstellationConfig, MapObject, TiledMap
from meshslam.motion import NavState
from tests.maps.test_constellation_index import CAR


class Mapping:
    """A local map that is there from the third frame on."""

    def __init__(self, local):
        self.local, self.frames = local, []

    def take(self, frame, time_s, imu, detections):
        self.frames.append(frame)

    def local_map(self):
        return self.local if len(self.frames) > 2 else None


@pytest.fixture
def street(tmp_path, rng):
    places = np.array([[0, 4], [7.5, -4], [13, 4.4], [21, -3.8], [28.5, 4], [34, -4.3]])
    sizes = np.exp(rng.normal(0, 0.08, (6, 3)))
    city = TiledMap.create(tmp_path / "city")
    city.put(
        MapObject(i, "car", Pose.from_yaw(rng.normal(0, 0.05), np.array([*p, 0.7])), CAR.vertices * s, CAR.faces)
        for i, (p, s) in enumerate(zip(places, sizes, strict=True))
    )
    return city


def test_a_place_has_the_first_state_true_to_scale_and_in_the_maps_axes(street):
    scale, map_from_local = 1.04, Pose.from_yaw(0.8, np.array([12.0, -3.0, 0.0]))
    known = Constellation.of([street[number] for number in street])
    local_from_map = map_from_local.inverse()
    seen = Constellation(
        local_from_map.transform(known.places), known.yaws_rad - 0.8, known.sizes, np.full(6, 0.05)
    ).scaled(1 / scale)
    own = NavState(5.0, Pose(np.eye(3), np.array([2.0, 1.0, 1.5])), np.array([8.0, 0.0, 0.1]), np.ones(3), np.ones(3))
    path = {7: Pose.identity(), 8: Pose(np.eye(3), np.array([1.0, 0.0, 0.0]))}
    config = RelocalizationConfig(search_every_s=0.2, give_up_s=0.5)
    fake = SimpleNamespace(constellations=street.constellations)
    search = PlaceSearch(fake, Mapping(LocalMap(own, seen, path)), config)
    found = [search.take(k, 0.1 * k, None, ()) for k in range(4)]
    assert found[:2] == [None, None]
    place = found[2]
    assert place is not None
    assert found[3] is None  # not every frame is searched
    assert np.allclose(place.map_from_local.matrix, map_from_local.matrix, atol=0.05)
    assert np.allclose(place.first_state.velocity_in_world, scale * own.velocity_in_world, atol=0.05)
    assert np.allclose(place.first_state.world_from_imu.translation, scale * own.world_from_imu.translation, atol=0.02)
    assert np.allclose(place.local_from_camera[8].translation, [scale, 0, 0], atol=0.01)
    in_map = moved_state(place.first_state, place.map_from_local)
    turned = map_from_local.rotation @ (scale * own.velocity_in_world)
    assert np.allclose(in_map.velocity_in_world, turned, atol=0.1)
    assert not search.is_over(0.4)
    assert search.is_over(0.6)


class Standing(Mapping):
    """A drive whose first seconds SLAM refuses."""

    def take(self, frame, time_s, imu, detections):
        raise SequenceError("the camera hardly moves")


def test_first_seconds_that_cannot_be_mapped_end_the_search_with_the_reason(street):
    search = PlaceSearch(SimpleNamespace(constellations=street.constellations), Standing(None), RelocalizationConfig())
    assert not search.is_over(0.0)
    assert search.take(0, 0.0, None, ()) is None
    assert search.is_over(0.0)
    assert search.refused == "the first seconds cannot be mapped: the camera hardly moves"


def test_why_nothing_was_found_is_kept(street):
    few = Constellation(np.zeros((2, 3)), np.zeros(2), np.ones((2, 3)), np.zeros(2))
    own = NavState(0.0, Pose.identity(), np.zeros(3), np.zeros(3), np.zeros(3))
    config = RelocalizationConfig(constellations=ConstellationConfig(min_objects=3))
    fake = SimpleNamespace(constellations=street.constellations)
    search = PlaceSearch(fake, Mapping(LocalMap(own, few, {})), config)
    assert [search.take(k, 1.0 * k, None, ()) for k in range(4)] == [None] * 4
    assert "2 objects" in search.refused
