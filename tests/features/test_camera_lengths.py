"""Step lengths of given poses against tracked points, road and the sizes of cars."""

import itertools

import numpy as np
import pytest

from meshslam.features import LengthConfig, LogFactor, PointConfig
from meshslam.features.camera_lengths import _moved, parts
from meshslam.features.image_path import image_path
from meshslam.features.length_judgement import Correction, Stretch, judge_stretch, judge_unit
from meshslam.geometry import Pose, exp_so3
from tests.fixtures.walled_road import CAMERA, blocks, drive, lengths_m, with_ratios

CONFIG = LengthConfig()
ROAD_SIGMA, CAR_SIGMA = 0.03, 0.07
SEEDS = range(3)


def no_cars(_poses):
    return None


def cars_of(true, sigma=CAR_SIGMA, factor=1.0):
    """Cars that tell the way from the first camera to the last, times a factor."""
    way = np.linalg.norm(true[-1].translation - true[0].translation) * factor
    return lambda poses: LogFactor(np.log(way / np.linalg.norm(poses[-1].translation - poses[0].translation)), sigma, 5)


def stretch_of(rng, true, given, *, has_road=True, **scene):
    """What points and road say of given poses, the road with an error of its own."""
    found = image_path(CAMERA, given, blocks(rng, true, **scene), PointConfig())
    way = [np.linalg.norm(poses[-1].translation - poses[0].translation) for poses in (true, found.world_from_camera)]
    road = LogFactor(np.log(way[0] / way[1]) + rng.normal(0, 0.01), ROAD_SIGMA, 8) if has_road else None
    return Stretch(0, len(given) - 1, given, found, road, CONFIG)


def as_navigated(rng, poses):
    """The errors that good poses have: a tenth of a degree, and millimetres."""
    return tuple(
        Pose(p.rotation @ exp_so3(rng.normal(0, 2e-3, 3)), p.translation + rng.normal(0, 2e-3, 3)) for p in poses
    )


def corrected_ratios(stretch, found):
    """Lengths after the correction over the given ones."""
    return lengths_m(_moved(stretch.given, [found])) / stretch.lengths_m


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("count", "step_m"), [(9, 0.9), (21, 0.8), (24, 0.25), (12, 0.1)])
def test_right_poses_are_not_touched(seed, count, step_m):
    rng = np.random.default_rng(seed)
    true = drive(step_m * rng.uniform(0.9, 1.1, count))
    stretch = stretch_of(rng, true, as_navigated(rng, true))
    assert stretch.is_right
    assert judge_stretch(stretch, no_cars) is None
    assert judge_unit([stretch], stretch.given, no_cars) is None


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("ratio", [1.16, 0.85, 1.6])
def test_one_wrong_step_among_right_ones_is_found_without_road_or_cars(seed, ratio):
    rng = np.random.default_rng(seed)
    true, wrong = drive(np.full(18, 0.8)), int(rng.integers(18))
    given = with_ratios(true, np.where(np.arange(18) == wrong, ratio, 1.0))
    stretch = stretch_of(rng, true, given, has_road=False)
    found = judge_stretch(stretch, no_cars)
    assert found.steps == (wrong,)
    ratios = corrected_ratios(stretch, found)
    assert ratios[wrong] == pytest.approx(1 / ratio, rel=0.025)
    np.testing.assert_allclose(np.delete(ratios, wrong), 1.0, atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_lengths_that_drift_get_their_unit_from_road_and_cars(seed):
    """As the first poses of KITTI odometry 00: the car speeds up by a fifth, the poses do not."""
    rng = np.random.default_rng(seed)
    true = drive(np.linspace(0.67, 0.81, 9))
    given = with_ratios(true, 0.86 / lengths_m(true))
    stretch = stretch_of(rng, true, given)
    assert not stretch.tells_unit
    for cars in (no_cars, cars_of(true)):
        found = judge_stretch(stretch, cars)
        assert len(found.steps) == 9
        np.testing.assert_allclose(corrected_ratios(stretch, found) * given_over(true, given), 1.0, atol=0.04)


def given_over(true, given):
    return lengths_m(given) / lengths_m(true)


@pytest.mark.parametrize("seed", SEEDS)
def test_half_of_the_steps_right_tell_the_unit_where_the_road_agrees_with_them(seed):
    rng = np.random.default_rng(seed)
    true, ratios = drive(np.full(20, 0.8)), np.where(np.arange(20) < 10, 1.2, 1.0)
    stretch = stretch_of(rng, true, with_ratios(true, ratios))
    found = judge_stretch(stretch, no_cars)
    assert found.steps == tuple(range(10))
    np.testing.assert_allclose(corrected_ratios(stretch, found) * ratios, 1.0, atol=0.02)
    alone = judge_stretch(stretch_of(rng, true, stretch.given, has_road=False), cars_of(true))
    assert alone.displacements_m is None


@pytest.mark.parametrize("seed", SEEDS)
def test_a_slow_drift_is_found_though_no_single_step_is_wrong(seed):
    rng = np.random.default_rng(seed)
    true = drive(np.full(24, 0.9))
    stretch = stretch_of(rng, true, with_ratios(true, np.linspace(1.0, 1.14, 24)))
    assert stretch.drifts
    assert stretch.noise < 0.01
    found = judge_stretch(stretch, cars_of(true))
    given = given_over(true, stretch.given)
    np.testing.assert_allclose(corrected_ratios(stretch, found) * given, 1.0, atol=0.04)


def test_without_a_road_or_with_cars_that_contradict_it_nothing_is_corrected(rng):
    true = drive(np.linspace(0.67, 0.81, 9))
    given = with_ratios(true, 0.86 / lengths_m(true))
    found = judge_stretch(stretch_of(rng, true, given, has_road=False), cars_of(true))
    assert found.displacements_m is None
    assert "the road does not tell" in found.note
    found = judge_stretch(stretch_of(rng, true, given), cars_of(true, factor=1.4))
    assert found.displacements_m is None
    assert "do not agree" in found.note


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("has_road", [True, False])
def test_noise_is_taken_out_and_the_way_stays(seed, has_road):
    rng = np.random.default_rng(seed)
    true = drive(np.full(20, 0.8))
    given = tuple(Pose(p.rotation, p.translation + rng.normal(0, 0.05, 3)) for p in true)
    stretch = stretch_of(rng, true, given, has_road=has_road)
    assert stretch.is_noisy
    found = judge_stretch(stretch, no_cars)
    before, after = given_over(true, given), corrected_ratios(stretch, found) * given_over(true, given)
    assert np.abs(np.log(before)).max() > 0.08
    assert np.abs(np.log(after)).max() < 0.03
    assert abs(np.log(after).mean()) < 0.015


@pytest.mark.parametrize("factor", [0.75, 1.3])
def test_all_lengths_wrong_alike_are_left_alone_unless_road_and_cars_agree(rng, factor):
    true = drive(np.full(15, 0.8))
    stretch = stretch_of(rng, true, with_ratios(true, np.full(15, factor)))
    assert judge_stretch(stretch, no_cars) is None  # points tell ratios alone
    found, note = judge_unit([stretch], stretch.given, cars_of(true))
    assert found * factor == pytest.approx(1.0, rel=0.04)
    assert "multiplied" in note
    for cars in (no_cars, cars_of(stretch.given), cars_of(true, sigma=0.3)):
        found, note = judge_unit([stretch], stretch.given, cars)
        assert found == 1.0
        assert "kept" in note
    assert judge_unit([stretch_of(rng, true, stretch.given, has_road=False)], stretch.given, cars_of(true)) is None


def test_points_that_do_not_agree_tell_nothing(rng):
    true = drive(np.full(9, 0.8))
    assert image_path(CAMERA, true, blocks(rng, true), PointConfig()) is not None
    assert image_path(CAMERA, true, blocks(rng, true, noise_px=3.0), PointConfig()) is None
    assert image_path(CAMERA, true, blocks(rng, true)[:1], PointConfig()) is None  # the last steps are not held


def test_the_points_know_how_well_they_know_ratios_and_not_their_unit():
    squares, true = [], drive(np.full(12, 0.8))
    for seed in range(8):
        rng = np.random.default_rng(seed)
        found = image_path(CAMERA, true, blocks(rng, true, noise_px=0.7, lost=0.0), PointConfig())
        assert found.information @ np.ones(12) == pytest.approx(np.zeros(12), abs=1e-4 * found.information.max())
        squares.append(found.log_ratios @ found.information @ found.log_ratios / 11)
    assert 0.5 < np.mean(squares) < 2.5  # each corner is in two rows here, with noise of its own


def test_what_follows_a_step_moves_with_it_and_what_comes_before_stays():
    given = drive(np.full(4, 1.0))
    step = given[3].translation - given[2].translation
    moved = _moved(given, [Correction("", (2,), np.array([0.5 * step])), Correction("nothing", ())])
    assert all(a is b for a, b in zip(moved[:3], given[:3], strict=True))
    np.testing.assert_allclose(
        [m.translation - g.translation for m, g in zip(moved[3:], given[3:], strict=True)], [-0.5 * step] * 2
    )
    assert _moved(given, [Correction("nothing", ())]) is given


def test_the_path_is_cut_where_the_camera_stands_and_into_parts_that_are_not_too_long():
    lengths = np.array([1.0] * 5 + [0.0] * 3 + [1.0] * 2 + [0.01] + [1.0] * 90)
    found = parts(lengths, CONFIG)
    assert found[0] == (0, 5)
    assert found[1][0] == 11
    assert found[-1][1] == 101
    assert all(b == c for (_, b), (c, _) in itertools.pairwise(found[1:]))
    assert all(3 <= b - a <= CONFIG.steps for a, b in found)
