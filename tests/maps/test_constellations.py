import time

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.maps import Constellation, ConstellationConfig, match_constellations, match_near
from meshslam.maps.neighbours import GroundGrid
from tests.reference.constellations import best_pose

NOISE_M, SIGMA_M = 0.05, 0.07


def street(rng, cars, spacing_m=6.5):
    """Parked cars on both sides of a road along x; no two overlap."""
    places = []
    for x in np.sort(rng.uniform(0, spacing_m * cars, cars)):
        place = np.array([x, rng.choice([-1, 1]) * rng.uniform(3.6, 5.0), 0.0])
        if all(np.linalg.norm(place - other) > 5.8 for other in places):
            places.append(place)
    count = len(places)
    yaws = rng.normal(0, 0.04, count) + np.pi * (rng.random(count) < 0.3)
    sizes = np.array([4.3, 1.75, 1.5]) * np.exp(rng.normal(0, 0.08, (count, 3)))
    return Constellation(np.array(places), yaws, sizes, np.full(count, SIGMA_M))


def seen_from(rng, world, pose, rows=slice(None), turned=0.0):
    """What a drive has of it, in its own world: `pose` is drive_from_world."""
    chosen = np.arange(len(world))[rows]
    places = pose.transform(world.places[chosen] + rng.normal(0, NOISE_M, (len(chosen), 3)))
    yaws = world.yaws_rad[chosen] + pose.yaw_rad + rng.normal(0, 0.02, len(chosen))
    yaws = yaws + np.pi * (rng.random(len(chosen)) < turned)
    sizes = world.sizes[chosen] * np.exp(rng.normal(0, 0.02, (len(chosen), 3)))
    return Constellation(places, yaws, sizes, np.full(len(chosen), SIGMA_M))


def any_pose(rng):
    return Pose.from_yaw(float(rng.uniform(-np.pi, np.pi)), rng.uniform(-200, 200, 3))


@pytest.mark.parametrize("seed", range(12))
def test_a_street_moved_by_any_turn_and_shift_is_laid_back(seed):
    rng = np.random.default_rng(seed)
    world, pose = street(rng, 12), any_pose(rng)
    found = match_constellations(world, seen_from(rng, world, pose))
    assert not found.refused
    assert all(k == s for k, s in found.pairs)
    assert len(found.pairs) >= 0.8 * len(world)
    there = found.known_from_seen.transform(pose.transform(world.places))
    assert np.linalg.norm(there - world.places, axis=1).max() < 4 * NOISE_M


@pytest.mark.parametrize("seed", range(6))
def test_two_drives_that_share_a_part_of_the_street(seed):
    rng = np.random.default_rng(seed)
    world = street(rng, 24)
    half = len(world) // 2
    one, other = any_pose(rng), any_pose(rng)
    found = match_constellations(
        seen_from(rng, world, one, slice(None, half + 4)), seen_from(rng, world, other, slice(half - 4, None))
    )
    assert not found.refused
    assert {k - s for k, s in found.pairs} == {half - 4}
    assert 6 <= len(found.pairs) <= 8


def test_cars_taken_the_wrong_way_round_are_known():
    rng = np.random.default_rng(3)
    world, pose = street(rng, 12), any_pose(rng)
    found = match_constellations(world, seen_from(rng, world, pose, turned=0.5))
    assert not found.refused
    assert all(k == s for k, s in found.pairs)
    assert len(found.pairs) >= 0.8 * len(world)


def test_cars_that_moved_meanwhile_do_not_hide_the_street():
    rng = np.random.default_rng(4)
    world, pose = street(rng, 16), any_pose(rng)
    places = world.places.copy()
    places[[2, 5, 9]] += [[0.0, 1.5, 0.0], [2.0, 0.0, 0.0], [-1.8, 0.0, 0.0]]
    changed = Constellation(places, world.yaws_rad, world.sizes, world.sigmas_m)
    found = match_constellations(world, seen_from(rng, changed, pose))
    assert not found.refused
    assert all(k == s for k, s in found.pairs)
    assert not {2, 5, 9} & {k for k, _ in found.pairs}


def test_a_repeated_constellation_is_refused_as_ambiguous():
    rng = np.random.default_rng(5)
    count = 16
    places = np.column_stack([6.0 * np.arange(count), np.full(count, 4.0), np.zeros(count)])
    sizes = np.tile([4.3, 1.75, 1.5], (count, 1))
    row = Constellation(places, np.zeros(count), sizes, np.full(count, SIGMA_M))
    found = match_constellations(row, seen_from(rng, row, any_pose(rng), slice(3, 9)))
    assert "another place fits about as well" in found.refused


def test_other_streets_are_refused():
    accepted = 0
    for seed in range(40):
        rng = np.random.default_rng(100 + seed)
        one, other = street(rng, 14), street(rng, 14)
        accepted += not match_constellations(one, seen_from(rng, other, any_pose(rng))).refused
    assert accepted <= 1


def test_too_few_objects_are_refused_with_the_number():
    rng = np.random.default_rng(6)
    world = street(rng, 8)
    assert "2 objects" in match_constellations(world, seen_from(rng, world, any_pose(rng), slice(2))).refused
    nothing = Constellation.of(())
    assert match_constellations(world, nothing).refused
    assert match_near(world, nothing, Pose.identity()).refused


@pytest.mark.parametrize("seed", range(4))
def test_the_slow_twin_finds_the_same(seed):
    rng = np.random.default_rng(200 + seed)
    world = street(rng, 9)
    seen = seen_from(rng, world, any_pose(rng), slice(1, 7))
    found = match_constellations(world, seen)
    yaw, shift, pairs = best_pose(world, seen)
    assert not found.refused
    assert set(found.pairs) <= set(pairs)
    assert len(found.pairs) >= len(pairs) - 1
    assert np.cos(found.known_from_seen.yaw_rad - yaw) > np.cos(0.02)
    middle = seen.places.mean(0)
    expected = Pose.from_yaw(yaw, np.append(shift, 0.0)).transform(middle)
    assert np.linalg.norm((found.known_from_seen.transform(middle) - expected)[:2]) < 0.2


def test_a_place_that_is_known_roughly_needs_no_search():
    rng = np.random.default_rng(7)
    world = street(rng, 10)
    rough = Pose.from_yaw(0.01, np.array([0.3, -0.2, 0.1]))
    found = match_near(world, seen_from(rng, world, rough.inverse()), Pose.identity())
    assert all(k == s for k, s in found.pairs)
    assert len(found.pairs) >= 0.8 * len(world)


def test_a_handful_is_found_among_many_streets_in_seconds():
    rng = np.random.default_rng(8)
    streets = [street(rng, 14) for _ in range(800)]
    moved = [
        Constellation(
            Pose.from_yaw(float(turn), np.array([120.0 * (i % 30), 120.0 * (i // 30), 0.0])).transform(one.places),
            one.yaws_rad + turn,
            one.sizes,
            one.sigmas_m,
        )
        for i, (one, turn) in enumerate(zip(streets, rng.uniform(-np.pi, np.pi, 800), strict=True))
    ]
    parts = ("places", "yaws_rad", "sizes", "sigmas_m")
    city = Constellation(*(np.concatenate([getattr(one, part) for one in moved]) for part in parts))
    first = sum(len(one) for one in moved[:400])
    handful = seen_from(rng, city, any_pose(rng), slice(first, first + 7))
    began_s = time.perf_counter()
    found = match_constellations(city, handful)
    assert time.perf_counter() - began_s < 30.0  # 0.3 s on a free core
    assert not found.refused
    assert {k - s for k, s in found.pairs} == {first}


def test_the_same_sets_give_the_same_answer_in_any_order_of_objects():
    rng = np.random.default_rng(9)
    world, pose = street(rng, 12), any_pose(rng)
    seen = seen_from(rng, world, pose)
    order = rng.permutation(len(seen))
    other = Constellation(seen.places[order], seen.yaws_rad[order], seen.sizes[order], seen.sigmas_m[order])
    one, two = match_constellations(world, seen), match_constellations(world, other)
    assert {(k, s) for k, s in one.pairs} == {(k, int(order[s])) for k, s in two.pairs}
    assert np.abs(one.known_from_seen.matrix - two.known_from_seen.matrix).max() < 1e-9


def test_the_settings_are_used():
    rng = np.random.default_rng(10)
    world, pose = street(rng, 8), any_pose(rng)
    seen = seen_from(rng, world, pose, slice(4))
    assert match_constellations(world, seen, ConstellationConfig(min_objects=5)).refused
    assert "evidence" in match_constellations(world, seen, ConstellationConfig(min_evidence=500.0)).refused


@pytest.mark.parametrize("radius_m", [0.5, 3.0, 40.0])
def test_a_grid_finds_what_trying_all_finds(radius_m):
    rng = np.random.default_rng(11)
    points, queries = rng.uniform(-30, 30, (200, 2)), rng.uniform(-35, 35, (60, 2))
    query, point = GroundGrid.of(points, radius_m).near(queries)
    apart = np.linalg.norm(queries[:, None] - points[None], axis=2)
    assert set(zip(query.tolist(), point.tolist(), strict=True)) == set(
        zip(*map(list, np.nonzero(apart <= radius_m)), strict=True)
    )
