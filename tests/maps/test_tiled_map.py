"""Maps in tiles: what goes in comes out, only what is asked is read, and a writer that dies leaves a whole map."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from meshslam.categories import category_names, load_category
from meshslam.errors import MapError
from meshslam.files import CITY, LOCK, arrays_to_bytes
from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject, TiledMap, tiled_map
from meshslam.maps.mesh_code import STEP_M, MeshCode, sigma_code, sigma_of_code
from meshslam.maps.tile import Tile

CAR = load_category("car")


@pytest.fixture
def make_car(rng):
    def make(number, x=0.0, y=0.0, *, symmetric=True, **changes):
        bumps = 0.02 * rng.normal(size=CAR.vertices.shape)
        if symmetric:
            bumps = (bumps + bumps[CAR.mirror] * [1, -1, 1]) / 2
        vertices = CAR.shape(rng.normal(size=8)) + bumps
        sigma = rng.uniform(0.01, 0.3, len(vertices))
        factor = 0.1 * rng.normal(size=(6, 6))
        fields = {
            "world_from_object": Pose.from_yaw(rng.uniform(0, 6), np.array([x, y, 0.7])),
            "vertices": vertices,
            "faces": CAR.faces,
            "views": 5,
            "first_frame": 3,
            "mask_iou": 0.75,
            "keypoints": dict(zip(CAR.keypoint_names, CAR.keypoints(vertices), strict=True)),
            "pose_covariance": factor @ factor.T,
            "vertex_sigma_m": (sigma + sigma[CAR.mirror]) / 2,
            "vertex_observed": rng.random(len(vertices)) < 0.4,
        }
        return MapObject(number, "car", **(fields | changes)).recentred()

    return make


@pytest.fixture
def city(tmp_path, make_car):
    made = TiledMap.create(tmp_path / "city")
    made.put([make_car(i, *place) for i, place in enumerate([(5, 5), (150, 20), (160, 90), (-30, 40), (990, -450)])])
    return made


def assert_same(found, given, *, vertices_m):
    assert (found.id, found.category, found.views) == (given.id, given.category, given.views)
    assert (found.first_frame, found.last_frame) == (given.first_frame, given.last_frame)
    assert np.abs(found.vertices - given.vertices).max() <= vertices_m
    assert np.array_equal(found.faces, given.faces)
    assert np.abs(found.world_from_object.matrix - given.world_from_object.matrix).max() < vertices_m
    assert found.keypoints.keys() == given.keypoints.keys()
    assert all(np.abs(found.keypoints[k] - p).max() <= 3 * vertices_m for k, p in given.keypoints.items())
    for name, rtol in (("pose_covariance", 1e-6), ("vertex_sigma_m", 0.019), ("mask_iou", 1e-6)):
        a, b = getattr(found, name), getattr(given, name)
        assert (a is None) == (b is None)
        if b is not None:
            np.testing.assert_allclose(a, b, rtol=rtol, atol=1e-9)
    assert (found.vertex_observed is None) == (given.vertex_observed is None)
    if given.vertex_observed is not None:
        assert np.array_equal(found.vertex_observed, given.vertex_observed)


@pytest.mark.parametrize("symmetric", [True, False])
def test_cars_come_back_to_half_a_millimetre(make_car, symmetric):
    cars = [make_car(i, symmetric=symmetric) for i in range(4)]
    cars.append(make_car(9, symmetric=symmetric, pose_covariance=None, vertex_sigma_m=None, vertex_observed=None))
    cars.append(make_car(10, mask_iou=None, keypoints={}, first_frame=None))
    models = {"car": CAR}
    tile = Tile.from_bytes(*Tile.of(cars, models).to_bytes(), models)
    for found, given in zip(tile.objects(), cars, strict=True):
        assert_same(found, given, vertices_m=STEP_M)


def test_other_meshes_come_back_as_single_precision_has_them(a_map):
    tile = Tile.from_bytes(*Tile.of(a_map.objects, {"car": CAR}).to_bytes(), {"car": CAR})
    for found, given in zip(tile.objects(), a_map.objects, strict=True):
        assert_same(found, given.recentred(), vertices_m=1e-6)


@pytest.mark.parametrize("name", category_names())
def test_every_shipped_category_is_written_by_its_modes(name, rng):
    model = load_category(name)
    code, meshes = MeshCode(model), np.array([model.shape(rng.normal(size=len(model.modes))) for _ in range(3)])
    assert all(code.covers(mesh, model.faces) and code.is_symmetric(mesh) for mesh in meshes)
    arrays = code.encode(meshes, symmetric=True)
    assert np.abs(arrays["residual"]).max() <= 2  # the modes say all but what their rounding leaves
    assert np.abs(code.decode(arrays, symmetric=True) - meshes).max() <= STEP_M


def test_sigmas_come_back_to_two_percent_from_a_millimetre_to_nine_metres():
    sigma = np.geomspace(1e-3, 9.0, 500)
    assert np.abs(sigma_of_code(sigma_code(sigma)) / sigma - 1).max() < 0.019


def test_a_car_of_the_map_takes_less_than_two_and_a_half_kilobytes(tmp_path, make_car):
    city = TiledMap.create(tmp_path / "city")
    city.put([make_car(i, 0.3 * i) for i in range(200)])
    assert sum(entry.bytes for entry in city.index.entries.values()) < 2500 * 200


def test_near_gives_what_is_near_as_a_map_of_all_does(city):
    whole, opened = city.loaded(), TiledMap.open(city.folder)
    for place, radius_m in (((0.0, 0.0), 60.0), ((155.0, 50.0, 0.7), 40.0), ((0.0, 0.0), 1e4), ((500.0, 500.0), 10.0)):
        at = np.array(place)
        assert [t.id for t in opened.near(at, radius_m)] == [t.id for t in whole.near(at, radius_m)]
    assert [t.id for t in opened.near(np.array([155.0, 50.0]), 60.0)] == [1, 2]


def test_it_is_a_mapping_like_a_map(city):
    whole = city.loaded()
    assert len(city) == len(whole) == 5
    assert sorted(city) == list(whole)
    assert 3 in city
    assert 77 not in city
    assert_same(city[3], whole[3], vertices_m=1e-12)
    with pytest.raises(KeyError, match="77"):
        city[77]
    assert isinstance(Map.open(city.folder), TiledMap)
    assert list(Map.load(city.folder)) == list(whole)
    assert list(Map.load(city.folder / CITY)) == list(whole)


def test_only_tiles_that_are_asked_are_read(city, monkeypatch):
    read = []
    monkeypatch.setattr(TiledMap, "_read", lambda self, entry, **_: read.append(entry.key) or FULL(self, entry))
    opened = TiledMap.open(city.folder)
    assert len(opened) == 5
    assert not read
    opened.near(np.array([155.0, 50.0]), 30.0)
    opened.near(np.array([155.0, 51.0]), 30.0)
    assert read == [(1, 0)]


FULL = TiledMap._read


def test_what_was_put_is_what_is_read_then(city, make_car):
    assert city[0].world_from_object.translation[0] == pytest.approx(5.0, abs=0.2)
    city.put([make_car(0, 7.0, 7.0)])
    assert city[0].world_from_object.translation[0] == pytest.approx(7.0, abs=0.2)


def test_an_object_that_moves_to_another_tile_leaves_the_first(city, make_car):
    before = {path.name for path in (city.folder / "tiles").iterdir()}
    city.put([make_car(1, -950.0, 3.0)])
    opened = TiledMap.open(city.folder)
    assert len(opened) == 5
    assert opened[1].world_from_object.translation[0] == pytest.approx(-950.0, abs=0.1)
    assert [t.id for t in opened.near(np.array([155.0, 50.0]), 100.0)] == [2]
    others = {opened.index.entries[key].table for key in ((0, 0), (-1, 0), (9, -5))}
    assert others < before  # tiles that did not change are the same files
    city.remove([1, 2])
    assert (1, 0) not in TiledMap.open(city.folder).index.entries


def test_the_same_objects_give_the_same_bytes_in_any_order(tmp_path, make_car):
    cars = [make_car(i, 60.0 * i) for i in range(6)]
    one, other = TiledMap.create(tmp_path / "one"), TiledMap.create(tmp_path / "other")
    one.put(cars)
    other.put(cars[3:])
    other.put(reversed(cars[:3]))
    assert one.digest == other.digest
    named = {p.name: p.read_bytes() for p in (tmp_path / "one" / "tiles").iterdir()}
    for name, content in named.items():
        assert (tmp_path / "other" / "tiles" / name).read_bytes() == content


def test_meshes_that_are_written_again_and_again_stay(tmp_path, make_car):
    city = TiledMap.create(tmp_path / "city")
    city.put([make_car(1, 5.0, 5.0), make_car(2, 5.0, 5.0, symmetric=False)])
    first = city.loaded()
    for number in range(3, 9):
        city.put([make_car(number, 5.0, 5.0)])
    for thing in first.objects:
        assert np.array_equal(city[thing.id].vertices, thing.vertices)
        assert np.array_equal(city[thing.id].world_from_object.matrix, thing.world_from_object.matrix)


@pytest.mark.parametrize("at", [0, 1, 3])
def test_a_change_that_the_disk_refuses_leaves_folder_and_open_map_as_they_were(city, make_car, monkeypatch, at):
    digest, left = city.digest, iter(range(at))
    write = tiled_map.write_together

    def full(*given):
        if next(left, None) is None:
            raise MapError("no space left on device")
        write(*given)

    monkeypatch.setattr(tiled_map, "write_together", full)
    with pytest.raises(MapError, match="no space"):
        city.put([make_car(i, 200.0 * i) for i in range(8)])
    monkeypatch.undo()
    assert city.digest == TiledMap.open(city.folder).digest == digest
    assert [thing.views for thing in city.loaded().objects] == [5] * 5
    city.put([make_car(50, 1.0)])
    assert len(TiledMap.open(city.folder)) == 6


def test_a_mesh_far_from_its_category_is_kept_whole(make_car, rng):
    odd = CAR.vertices + 7.9 * np.sign(rng.normal(size=CAR.vertices.shape))
    thing = make_car(1, vertices=odd, keypoints={}, vertex_sigma_m=None, vertex_observed=None)
    tile = Tile.from_bytes(*Tile.of([thing], {"car": CAR}).to_bytes(), {"car": CAR})
    assert np.abs(tile.objects()[0].vertices - thing.vertices).max() <= STEP_M
    code, meshes = MeshCode(CAR), CAR.vertices[None].copy()
    meshes[0, 5] += 25.0  # more steps than 16 bits hold
    assert np.abs(code.decode(code.encode(meshes, symmetric=False), symmetric=False) - meshes).max() <= STEP_M


def test_a_mesh_whose_middle_is_moved_by_rounding_stays(tmp_path, make_car):
    thing = make_car(1, 5.0, 5.0, symmetric=False)
    half_m = (np.round(np.ptp(thing.vertices[:, 0]) / 2 / STEP_M) + 0.5) * STEP_M
    longer = thing.vertices * [2 * half_m / np.ptp(thing.vertices[:, 0]), 1, 1]
    longer[:, 0] += 4e-7  # less than is recentred, enough for one end to be rounded up and the other down
    city = TiledMap.create(tmp_path / "city")
    city.put([replace(thing, vertices=longer)])
    first = city[1]
    assert np.abs(first.vertices[:, 0].max() + first.vertices[:, 0].min()) > 0.9 * STEP_M
    city.put([make_car(2, 5.0, 5.0)])
    assert np.array_equal(city[1].vertices, first.vertices)
    assert np.array_equal(city[1].world_from_object.matrix, first.world_from_object.matrix)


def test_a_category_of_ones_own_goes_along(tmp_path, make_car, rng):
    mine = replace(CAR, name="go-kart/no. 1", vertices=0.4 * CAR.vertices, modes=0.4 * CAR.modes)
    thing = replace(
        make_car(1), category="go-kart/no. 1", vertices=mine.shape(rng.normal(size=5)), keypoints={}
    ).recentred()
    city = TiledMap.create(tmp_path / "city")
    city.put([thing], categories={"go-kart/no. 1": mine})
    assert (tmp_path / "city" / "categories" / city.index.categories["go-kart/no. 1"]).is_file()
    assert_same(TiledMap.open(tmp_path / "city")[1], thing, vertices_m=STEP_M)
    assert sum(e.bytes for e in city.index.entries.values()) < 6000  # by its modes, not vertex by vertex


def test_two_objects_of_one_id_are_refused_and_nothing_changes(city, make_car):
    with pytest.raises(MapError, match="different ids"):
        city.put([make_car(50), make_car(50)])
    assert len(TiledMap.open(city.folder)) == 5


def test_a_map_that_another_process_wrote_to_is_not_written_over(city, make_car):
    other = TiledMap.open(city.folder)
    city.put([make_car(60)])
    with pytest.raises(MapError, match="open it again"):
        other.put([make_car(61)])
    assert len(TiledMap.open(city.folder)) == 6


def test_what_was_open_before_a_change_is_still_read(city, make_car):
    before = TiledMap.open(city.folder)
    city.put([make_car(0, 7.0, 7.0)])
    assert before[0].world_from_object.translation[0] == pytest.approx(5.0, abs=0.2)


KILLED = """
import os, sys
from meshslam.maps import TiledMap, Map
import meshslam.maps.tiled_map as module
left = int(sys.argv[2])
write = module.write_together
def counted(*given):
    global left
    if left == 0:
        os.kill(os.getpid(), 9)
    left -= 1
    write(*given)
module.write_together = counted
index = module.write_atomically
def last(path, content, *more):
    if path.name == "city.json" and len(sys.argv) > 3:
        os.kill(os.getpid(), 9)
    index(path, content, *more)
module.write_atomically = last
city = TiledMap.open(sys.argv[1])
from dataclasses import replace
city.put([replace(thing, views=99) for thing in city.loaded().objects])
"""


@pytest.mark.parametrize("tiles", [0, 1, 3])
def test_a_writer_that_is_killed_leaves_the_map_as_it_was(city, tiles, make_car):
    done = subprocess.run([sys.executable, "-c", KILLED, city.folder, str(tiles)], check=False)
    assert done.returncode == -9
    assert (city.folder / LOCK).exists()
    left = TiledMap.open(city.folder)
    assert left.check() == []
    assert [thing.views for thing in left.loaded().objects] == [5] * 5
    left.put([make_car(70)])  # the lock of a dead process is taken over, its files go
    named = {name for e in left.index.entries.values() for name in (e.table, e.meshes)}
    left.put([make_car(71)])
    stale = {p.name for p in (city.folder / "tiles").iterdir()} - named
    assert len(stale) <= 2  # of the tile that the last change wrote


def test_a_writer_that_is_killed_before_the_index_leaves_the_map_as_it_was(city):
    subprocess.run([sys.executable, "-c", KILLED, city.folder, "1000", "index"], check=False)
    assert [thing.views for thing in TiledMap.open(city.folder).loaded().objects] == [5] * 5


def damaged(city, change):
    document = json.loads((city.folder / CITY).read_text())
    change(document)
    (city.folder / CITY).write_text(json.dumps(document))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d.update(format="other"), "expected 'meshslam-city' version 2"),
        (lambda d: d.update(version=1), "found 'meshslam-city' version 1"),
        (lambda d: d.pop("tiles"), "damaged: 'tiles'"),
        (lambda d: d.update(tile_m="x"), "damaged"),
        (lambda d: d["tiles"][0].__setitem__(6, "../../etc/passwd"), "digests are not 32 hexadecimal digits"),
        (lambda d: d["tiles"][0].__setitem__(0, "../0"), "expected whole numbers"),
        (lambda d: d["columns"].reverse(), "expected \\['column'"),
        (lambda d: d["categories"].update(car="/etc/passwd"), "no name of a file in the map's folder"),
        (lambda d: d["tiles"][0].pop(), "damaged"),
    ],
)
def test_a_damaged_index_is_told(city, change, says):
    damaged(city, change)
    with pytest.raises(MapError, match=says) as told:
        Map.open(city.folder)
    assert str(city.folder / CITY) in str(told.value)


def test_damaged_and_missing_tiles_are_told_by_name(city):
    entry = city.index.entries[(1, 0)]
    table, meshes = (city.folder / "tiles" / name for name in (entry.table, entry.meshes))
    content = meshes.read_bytes()
    meshes.write_bytes(content[: len(content) // 2])
    with pytest.raises(MapError, match=r"1_0\.[0-9a-f]+\.objects\.npz: not a readable"):
        TiledMap.open(city.folder).near(np.array([150.0, 20.0]), 5.0)
    assert len(TiledMap.open(city.folder).near(np.array([5.0, 5.0]), 5.0)) == 1
    assert [line for line in city.check() if "content was changed" in line]
    table.unlink()
    with pytest.raises(MapError, match="open it again"):
        TiledMap.open(city.folder).loaded()
    assert [line for line in city.check() if "missing" in line]


def test_arrays_of_wrong_shapes_are_told(city, make_car):
    tile = Tile.of([make_car(1)], {"car": CAR})
    for key, array in tile.meshes.items():
        for other in (array[..., :0], array[:1, :1]):
            if other.shape != array.shape:
                with pytest.raises(MapError):
                    Tile(tile.table, {**tile.meshes, key: other}, {"car": CAR}).objects()
    _, meshes = tile.to_bytes()
    for key in tile.table:
        for other in (np.array([[np.nan]]), np.zeros((0, 3)), np.array(7)):
            with pytest.raises(MapError):
                Tile.from_bytes(arrays_to_bytes({**tile.table, key: other}), meshes, {"car": CAR})
        left = {name: array for name, array in tile.table.items() if name != key}
        with pytest.raises(MapError, match=f"{key} is missing"):
            Tile.from_bytes(arrays_to_bytes(left), meshes, {"car": CAR})


@pytest.mark.parametrize("place", [(np.nan, 0.0), (1.0,), "x"])
def test_a_place_that_is_none_is_refused(city, place):
    for scene in (city, city.loaded()):
        with pytest.raises((MapError, ValueError)):
            scene.near(np.array(place), 5.0)


def test_a_map_is_not_begun_where_one_is(city):
    with pytest.raises(MapError, match="holds a map in tiles already"):
        TiledMap.create(city.folder)
