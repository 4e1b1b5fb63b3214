"""A handful of cars in a map in tiles: the index finds what a search among all objects finds, and follows changes."""

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.geometry import ParkedMap, ParkedRules, Pose, parked_rows
from meshslam.maps import (
    Constellation,
    ConstellationConfig,
    MapObject,
    TiledMap,
    constellation_index,
    find_constellation,
)
from meshslam.maps import match_constellations as search_among_all
from meshslam.maps.constellation_index import FOLDER
from tests.reference.constellations import pose_score

RADIUS_M, TILE_M, SHARD_TILES = 40.0, 48.0, 4  # a shard is 192 m wide
CAR = load_category("car")


def car(number, place, yaw_rad, scale):
    vertices = CAR.vertices * scale
    turned = Pose.from_yaw(yaw_rad, np.array([*place, 0.7]))
    return MapObject(number, "car", turned, vertices, CAR.faces, pose_covariance=np.diag([0.01] * 3 + [1e-3] * 3))


def streets(rng, count):
    """Cars along streets across several shards, on both sides of their borders."""
    cars, places = [], []
    while len(cars) < count:
        street = rng.integers(8)
        place = np.array([rng.uniform(-250, 250), 60.0 * street - 200 + rng.choice([-4.0, 4.0])])
        if all(np.linalg.norm(place - other) > 5.5 for other in places):
            places.append(place)
            yaw_rad = rng.normal(0, 0.05) + np.pi * (rng.random() < 0.3)
            cars.append(car(len(cars) + 1, place, yaw_rad, np.exp(rng.normal(0, 0.08, 3))))
    return cars


def seen_from(rng, objects, pose):
    """What a camera's own map has of some objects: `pose` is own_from_world."""
    known = Constellation.of(objects)
    places = pose.transform(known.places + rng.normal(0, 0.05, known.places.shape))
    sizes = known.sizes * np.exp(rng.normal(0, 0.02, known.sizes.shape))
    return Constellation(places, known.yaws_rad + pose.yaw_rad, sizes, np.full(len(known), 0.07))


def near(objects, place, count):
    return sorted(objects, key=lambda o: np.linalg.norm(o.world_from_object.translation[:2] - place))[:count]


@pytest.fixture(autouse=True)
def small_shards(monkeypatch):
    monkeypatch.setattr(constellation_index, "_SHARD_TILES", SHARD_TILES)


@pytest.fixture(scope="module")
def city(tmp_path_factory):
    made = TiledMap.create(tmp_path_factory.mktemp("index") / "city", tile_m=TILE_M)
    made.put(streets(np.random.default_rng(3), 320))
    return made


@pytest.mark.parametrize("place", [(0, 0), (-8, -8), (190, 100), (-200, 40)])
def test_a_handful_is_found_where_a_search_among_all_finds_it(city, place):
    rng = np.random.default_rng(abs(int(place[0])) + 1)
    objects = [city[number] for number in city]
    own_from_world = Pose.from_yaw(float(rng.uniform(-3, 3)), rng.uniform(-50, 50, 3))
    chosen = near(objects, np.array(place), 7)
    seen = seen_from(rng, chosen, own_from_world)
    found = find_constellation(city.constellations(RADIUS_M), seen)
    among_all = search_among_all(Constellation.of(objects), seen)
    assert not found.refused
    assert {(number, s) for number, s in found.pairs} == {(objects[k].id, s) for k, s in among_all.pairs}
    assert np.allclose(found.known_from_seen.matrix, among_all.known_from_seen.matrix, atol=1e-3)  # to single precision
    assert found.evidence == pytest.approx(among_all.evidence, abs=0.5)
    assert np.abs((found.known_from_seen @ own_from_world).matrix - np.eye(4)).max() < 0.15


@pytest.mark.parametrize("scale", [0.95, 1.06])
def test_a_handful_in_a_world_that_is_too_large_or_small_is_found_with_its_scale(city, scale):
    rng = np.random.default_rng(9)
    chosen = near([city[number] for number in city], np.array([60.0, 40.0]), 8)
    seen = seen_from(rng, chosen, Pose.from_yaw(2.0, np.array([9.0, -4.0, 0.0]))).scaled(1 / scale)
    index, free = city.constellations(RADIUS_M), ConstellationConfig(scale_sigma=0.04)
    found = find_constellation(index, seen, free)
    assert not found.refused
    assert found.scale == pytest.approx(scale, abs=0.01)
    assert len(found.pairs) >= 7
    rigid = find_constellation(index, seen)
    assert rigid.scale == 1.0
    assert rigid.evidence < found.evidence


def test_cars_of_no_street_of_the_map_are_refused(city):
    rng = np.random.default_rng(4)
    others = near(streets(np.random.default_rng(77), 60), np.zeros(2), 6)
    found = find_constellation(city.constellations(RADIUS_M), seen_from(rng, others, Pose.identity()))
    assert found.refused
    assert (
        "2 objects"
        in find_constellation(city.constellations(RADIUS_M), seen_from(rng, others[:2], Pose.identity())).refused
    )


def test_shards_hold_each_pair_of_near_objects_once(city):
    objects = {number: city[number].world_from_object.translation[:2] for number in city}
    wanted = {
        (a, b)
        for a, one in objects.items()
        for b, other in objects.items()
        if a < b and 2.0 < np.linalg.norm(one - other) <= RADIUS_M
    }
    found = []
    shards = list(city.constellations(RADIUS_M).shards())
    assert len(shards) > 4
    for shard in shards:
        ids = shard.cars["id"]
        rows = np.asarray(shard.pairs)
        found += [(int(ids[i]), int(ids[j])) for i, j in rows]
        lengths = np.linalg.norm(shard.cars["place"][rows[:, 0], :2] - shard.cars["place"][rows[:, 1], :2], axis=1)
        assert (np.diff(lengths) >= 0).all()
        between = shard.pairs_between(12.0, 17.5)
        assert len(between) == ((lengths >= 12.0) & (lengths <= 17.5)).sum()
    assert len(found) == len(set(found)) == len(wanted)
    assert set(found) == wanted


def test_only_shards_that_changed_are_made_again(tmp_path):
    rng = np.random.default_rng(5)
    cars = streets(rng, 120)
    city = TiledMap.create(tmp_path / "city", tile_m=TILE_M)
    city.put(cars)
    seen = seen_from(rng, near(cars, np.array([-240.0, -190.0]), 6), Pose.identity())
    assert not find_constellation(city.constellations(RADIUS_M), seen).refused
    folder = city.folder / FOLDER
    before = {file.name: file.stat().st_mtime_ns for file in folder.iterdir()}
    shown = near(cars, np.array([-240.0, -190.0]), 6)
    city.remove([thing.id for thing in shown])
    assert find_constellation(city.constellations(RADIUS_M), seen).refused
    after = {file.name: file.stat().st_mtime_ns for file in folder.iterdir()}
    kept = {name for name in before if after.get(name) == before[name]}
    assert 0 < len(kept) < len(before)
    assert len(after) <= len(before)  # nothing of the state before stays


def damage(folder):
    for file in folder.glob("*.pairs.npy"):
        file.write_bytes(file.read_bytes()[:70])
    for file in folder.glob("*.cars.npy"):
        file.write_bytes(b"nothing")


def garble(folder):
    for file in folder.glob("*.pairs.npy"):
        np.save(file, np.load(file) + 10**6)


def spoil(folder):
    for file in folder.glob("*.cars.npy"):
        cars = np.load(file)
        cars["place"] = np.nan
        np.save(file, cars)


def forbid(folder):
    for file in folder.iterdir():
        file.unlink()
    folder.rmdir()
    folder.write_text("a file where the folder should be")


@pytest.mark.parametrize("harm", [damage, garble, spoil, forbid])
def test_an_index_that_is_damaged_or_cannot_be_written_is_made_anew(tmp_path, harm):
    rng = np.random.default_rng(6)
    cars = streets(rng, 160)
    city = TiledMap.create(tmp_path / "city", tile_m=TILE_M)
    city.put(cars)
    seen = seen_from(rng, near(cars, np.zeros(2), 6), Pose.identity())
    first = find_constellation(city.constellations(RADIUS_M), seen)
    harm(city.folder / FOLDER)
    again = find_constellation(city.constellations(RADIUS_M), seen)
    assert not first.refused
    assert again.pairs == first.pairs
    assert city.check() == []


def test_a_table_tells_the_constellation_that_the_objects_have(city):
    for key in sorted(city.index.entries)[:40:8]:
        told, meant = city.table(key).constellation, Constellation.of(city.tile(key))
        assert np.array_equal(told.places, meant.places)
        assert np.allclose(told.yaws_rad, meant.yaws_rad)
        assert np.allclose(told.sizes, meant.sizes, atol=1e-9)
        assert np.allclose(told.sigmas_m, meant.sigmas_m, rtol=1e-5)


@pytest.mark.parametrize("scale_sigma", [0.0, 0.05])
def test_the_cores_scores_are_those_of_the_slow_twin(scale_sigma):
    rng = np.random.default_rng(7)
    known = Constellation.of(streets(rng, 40))
    chosen = [3, 8, 11, 20]
    pose = Pose.from_yaw(0.7, np.array([30.0, -12.0, 0.0]))
    places = pose.transform(known.places[chosen] + rng.normal(0, 0.1, (4, 3)))
    seen = Constellation(places, known.yaws_rad[chosen] + 0.7, known.sizes[chosen] * 1.02, np.full(4, 0.1))
    rules = ParkedRules(0.045, 0.01, np.radians(4.0), 0.0032, 0.0232, 0.05, 3.7, scale_sigma)
    pairs = np.array([[i, j] for i in range(40) for j in range(i)], np.int32)
    rows = [parked_rows(of.places, of.yaws_rad, of.sizes, of.sigmas_m) for of in (known, seen)]
    for end in ((0, 1), (2, 3), (0, 3)):
        found = ParkedMap(rows[0]).candidates(rows[1], [end], [pairs], rules, 5)
        meant = pose_score(known, seen, end, [tuple(pair) for pair in pairs.tolist()], rules, 5)
        assert len(found) == len(meant)
        assert np.allclose(found, meant, atol=1e-9)


def test_the_core_refuses_what_is_no_object():
    rules = ParkedRules(0.045, 0.01, 0.07, 0.0032, 0.0232, 0.05, 3.7)
    rows, pair = np.zeros((2, 7)), np.array([[0, 1]], np.int32)
    with pytest.raises(ValueError, match="finite"):
        ParkedMap(np.full((1, 7), np.nan))
    with pytest.raises(ValueError, match="shape"):
        ParkedMap(np.zeros((1, 6)))
    with pytest.raises(IndexError):
        ParkedMap(rows).candidates(rows, [(0, 5)], [pair], rules, 1)
    with pytest.raises(IndexError):
        ParkedMap(rows).candidates(rows, [(0, 1)], [pair + 1], rules, 1)
    with pytest.raises(ValueError, match="entries"):
        ParkedMap(rows).candidates(rows, [(0, 1)], [], rules, 1)
    assert len(ParkedMap(rows).candidates(rows, [(0, 1)], [pair], rules, 1)) == 0  # two objects at one place
    assert len(ParkedMap(np.zeros((0, 7))).candidates(rows, [(0, 1)], [pair[:0]], rules, 1)) == 0


def test_a_change_beside_a_shard_changes_its_pairs(tmp_path):
    """Two cars on both sides of a shard's border: the pair is the shard's whose car has the lesser id."""
    city = TiledMap.create(tmp_path / "city", tile_m=TILE_M)
    border_m = SHARD_TILES * TILE_M
    city.put([car(1, (border_m - 5.0, 10.0), 0.0, 1.0), car(2, (border_m + 5.0, 10.0), 0.0, 1.0)])
    assert [len(shard.pairs) for shard in city.constellations(RADIUS_M).shards()] == [1, 0]
    city.remove([2])
    city.put([car(3, (border_m + 90.0, 10.0), 0.0, 1.0)])
    assert [len(shard.pairs) for shard in city.constellations(RADIUS_M).shards()] == [0, 0]
