"""Of a map in tiles only what is around the camera is ready."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import MapError
from meshslam.geometry import Pose
from meshslam.localization import KnownMap
from meshslam.maps import Map, MapObject, TiledMap

CAR = load_category("car")


@pytest.fixture
def street():
    """A car every 20 m along 2 km."""
    return Map(
        tuple(
            MapObject(i, "car", Pose.from_yaw(0.1, np.array([20.0 * i, 3.0, 0.7])), CAR.vertices, CAR.faces)
            for i in range(100)
        )
    )


@pytest.fixture
def tiled(street, tmp_path):
    made = TiledMap.create(tmp_path / "city")
    made.put(street.objects)
    return TiledMap.open(tmp_path / "city")


def near(things, x, reach_m):
    return {t.id for t in things if abs(t.world_from_object.translation[0] - x) <= reach_m}


def test_along_a_drive_all_that_is_in_reach_is_ready_and_what_is_behind_is_dropped(street, tiled):
    known, held = KnownMap(tiled, 70.0), []
    for x in np.arange(0.0, 2000.0, 13.0):
        found = known.around(np.array([x, 0.0, 1.6]))
        assert near(street.objects, x, 65.0) <= {thing.id for thing in found}
        assert [thing.id for thing in found] == sorted(thing.id for thing in found)
        held.append(sum(map(len, known._tiles.values())))
    assert max(held) <= 25
    assert len(known) == 100


def test_standing_between_two_tiles_reads_none_again(tiled, monkeypatch):
    read = []
    tile = TiledMap.tile
    monkeypatch.setattr(TiledMap, "tile", lambda self, key: read.append(key) or tile(self, key))
    known = KnownMap(tiled, 70.0)
    for k in range(20):
        known.around(np.array([127.0 + 5.0 * (k % 2), 0.0, 1.6]))
    assert len(read) == len(set(read))


def test_in_another_world_the_same_objects_are_ready(street, tiled):
    turned = Pose.exp(np.array([100.0, -50.0, 3.0, 0.02, -0.03, 2.0]))
    known = KnownMap(tiled, 70.0, turned)
    found = known.around(turned.transform(np.array([[500.0, 0.0, 1.6]]))[0])
    assert near(street.objects, 500.0, 65.0) <= {thing.id for thing in found}
    (car,) = (thing for thing in found if thing.id == 25)
    assert np.allclose(car.world_from_object.matrix, (turned @ street[25].world_from_object).matrix, atol=1e-9)


def test_in_a_large_map_a_start_is_not_looked_for_among_all_objects(street, tiled, tmp_path):
    assert not KnownMap(tiled, 70.0).is_large
    assert len(KnownMap(tiled, 70.0).all_of_few()) == 100
    large = TiledMap.create(tmp_path / "large")
    large.put(replace(street[0], id=i, world_from_object=Pose.from_yaw(0, np.array([i, 0, 0.0]))) for i in range(1001))
    known = KnownMap(large, 70.0)
    assert known.is_large
    assert len(known.constellations(40.0)) == 1001
    assert known.constellations(40.0) is known.constellations(40.0)
    large.remove([5])
    assert len(known.constellations(40.0)) == 1000  # as the map is now
    assert not KnownMap(large.loaded(), 70.0).is_large


def test_an_empty_map_is_refused(tmp_path):
    for scene in (Map(()), TiledMap.create(tmp_path / "city")):
        with pytest.raises(MapError, match="holds no objects"):
            KnownMap(scene, 70.0)
