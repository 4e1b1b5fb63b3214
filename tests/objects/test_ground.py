import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.objects import ObjectConfig, ground
from meshslam.objects.ground import ground_near, road_points

CONFIG = ObjectConfig()


def cameras_over(height_of, xs, height_m=1.65, ys=None):
    ys = np.zeros(len(xs)) if ys is None else ys
    return [Pose(np.eye(3), np.array([x, y, height_of(x, y) + height_m])) for x, y in zip(xs, ys, strict=True)]


@pytest.mark.parametrize("slope", [-0.06, -0.02, 0.0, 0.03, 0.05])
def test_the_slope_along_the_path_is_found(slope):
    road = road_points(cameras_over(lambda x, y: slope * x + 0.4, np.arange(0, 40, 0.8)), 1.65)
    plane = ground_near(road, np.array([20.0, 4.0, 1.0]), CONFIG)
    assert -plane.normal[0] / plane.normal[2] == pytest.approx(slope, abs=0.15 * abs(slope) + 1e-9)
    assert np.linalg.norm(plane.normal) == pytest.approx(1.0)
    assert plane.height_m(np.array([20.0, 0.0, slope * 20 + 0.4])) == pytest.approx(0.0, abs=0.02)


def test_a_hill_is_followed_locally():
    road = road_points(cameras_over(lambda x, y: 0.0006 * x**2, np.arange(-60, 60, 1.0)), 1.65)
    for x in (-30.0, 0.0, 30.0):
        plane = ground_near(road, np.array([x, 3.0, 0.0]), CONFIG)
        assert plane.height_m(np.array([x, 0.0, 0.0006 * x**2])) == pytest.approx(0.0, abs=0.08)


def test_less_is_known_further_from_the_path():
    road = road_points(cameras_over(lambda x, y: 0.0, np.arange(0, 30, 1.0)), 1.65)
    sigmas = [ground_near(road, np.array([15.0, y, 0.0]), CONFIG).height_sigma_m for y in (0.0, 3.0, 8.0, 20.0)]
    assert sigmas == sorted(sigmas)
    assert sigmas[0] == pytest.approx(CONFIG.ground_height_sigma_m)
    assert sigmas[-1] > 3 * sigmas[0]


@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_cameras_give_a_level_plane_below_them(count):
    road = road_points(cameras_over(lambda x, y: 5.0, np.arange(count) * 0.5), 1.65)
    plane = ground_near(road, np.array([9.0, -2.0, 5.5]), CONFIG)
    np.testing.assert_allclose(plane.normal, [0, 0, 1], atol=1e-6)
    assert plane.offset_m == pytest.approx(5.0, abs=1e-6)


def test_a_world_moved_moves_the_plane(rng):
    xs, ys = np.cumsum(rng.uniform(0.5, 1.5, 25)), np.cumsum(rng.normal(0, 0.3, 25))
    road = road_points(cameras_over(lambda x, y: 0.02 * x - 0.01 * y, xs, ys=ys), 1.7)
    shift, position = np.array([1000.0, -500.0, 80.0]), np.array([12.0, 3.0, 0.5])
    here, there = ground_near(road, position, CONFIG), ground_near(road + shift, position + shift, CONFIG)
    np.testing.assert_allclose(there.normal, here.normal, atol=1e-9)
    assert there.height_m(position + shift) == pytest.approx(here.height_m(position), abs=1e-8)


def test_a_path_that_is_far_too_long_gives_the_same_plane(monkeypatch):
    """Of points without a weight nothing is computed: with and without them all is the same to the last bit."""
    at = np.arange(0, 6000.0)
    road = road_points(cameras_over(lambda x, y: 0.2 * np.sin(x / 80), at, ys=20 * np.sin(at / 100)), 1.65)
    places = [np.array([x, 4.0, 0.0]) for x in (0.0, 700.0, 3000.0, 5990.0)]
    near = [ground_near(road, place, CONFIG) for place in places]
    used = [len(ground._in_reach(road, place)) for place in places]
    monkeypatch.setattr(ground, "_REACH_M", np.inf)
    for plane, place, count in zip(near, places, used, strict=True):
        whole = ground_near(road, place, CONFIG)
        np.testing.assert_array_equal(plane.normal, whole.normal)
        assert (plane.offset_m, plane.height_sigma_m) == (whole.offset_m, whole.height_sigma_m)
        assert count < 900
