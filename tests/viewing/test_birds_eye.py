import re

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.maps import Map
from meshslam.viewing import birds_eye
from meshslam.viewing.from_above import BAND_PX, footprint, make_plan, position_covariance, round_length_m


def random_path(rng, count):
    return np.cumsum(rng.normal([0.9, 0.4, 0.0], 0.3, (count, 3)), axis=0)


@pytest.mark.parametrize("size", [0.5, 30.0, 2000.0])
def test_one_scale_for_all_directions(rng, size):
    path, others = size * random_path(rng, 20), size * rng.normal(size=(30, 3))
    plan = make_plan(path, others)
    pixels, flat = plan.pixels(others), others[:, :2]
    apart = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
    np.testing.assert_allclose(
        apart, plan.scale_px_per_m * np.linalg.norm(flat[:, None] - flat[None], axis=2), rtol=1e-9, atol=1e-6
    )


def test_is_not_mirrored_and_runs_to_the_right(rng):
    for _ in range(20):
        turned = Pose.from_yaw(rng.uniform(-np.pi, np.pi), np.zeros(3))
        path = turned.transform(random_path(rng, 10))
        plan = make_plan(path, rng.normal(size=(5, 3)))
        assert np.linalg.det(plan.rotation) == pytest.approx(1.0)
        start, end = plan.pixels(path[[0, -1]])
        assert end[0] > start[0]
        forward, left = plan.pixels(path[0] + turned.rotation.T[:2]) - start
        assert forward[0] * -left[1] - forward[1] * -left[0] != 0
        assert forward[0] * left[1] - forward[1] * left[0] < 0  # y runs down the paper


def test_everything_is_on_the_paper(rng):
    for spread in (1e-3, 1.0, 300.0):
        path, others = spread * random_path(rng, 15), spread * rng.normal(size=(9, 3))
        plan = make_plan(path, others)
        pixels = plan.pixels(np.concatenate([path, others]))
        assert (pixels >= 0).all()
        assert (pixels <= [plan.width_px, plan.height_px]).all()


@pytest.mark.parametrize("path", [np.zeros((0, 3)), np.zeros((1, 3)), np.ones((5, 3))])
def test_a_path_that_does_not_move(path, cars):
    poses = [Pose(np.eye(3), p) for p in path]
    for scene_map in (cars, Map(())):
        picture = birds_eye(scene_map, poses)
        assert "nan" not in picture
        assert picture.count("<ellipse") == len(scene_map)


def test_the_scale_bar_is_as_long_as_it_says(cars, path):
    picture = birds_eye(cars, path)
    length_px, length_m = re.search(r'v5h([\d.]+)v-5"/><text[^>]*>([\d.e+]+) m<', picture).groups()
    corners = np.concatenate([footprint(thing) for thing in cars.objects])
    points = np.array([pose.translation for pose in path])
    scale = make_plan(points, np.column_stack([corners, np.zeros(len(corners))])).scale_px_per_m
    assert float(length_px) == pytest.approx(scale * float(length_m), abs=0.01)
    height = float(re.search(r'viewBox="0 0 [\d.]+ ([\d.]+)"', picture).group(1))
    assert height > BAND_PX


@pytest.mark.parametrize("longest", [0.0123, 0.99, 1.0, 4.9, 5.0, 99.0, 12345.0])
def test_round_lengths(longest):
    length = round_length_m(longest)
    assert length <= longest * (1 + 1e-9) < 2.51 * length
    assert f"{length:e}"[0] in "125"


def test_a_footprint_holds_every_vertex_and_no_more(cars, rng):
    for thing in cars.objects:
        hull, flat = footprint(thing), thing.vertices_in_world[:, :2]
        for direction in rng.normal(size=(40, 2)):
            assert (hull @ direction).max() == pytest.approx((flat @ direction).max(), abs=1e-4)


def test_ellipses_are_one_sigma(make_car, path):
    thing = make_car(1, 8.0, 3.0, 0.7, pose_covariance=np.diag([0.5, 0.2, 0.1, 0.1, 0.1, 0.1]) ** 2)
    picture = birds_eye(Map((thing,)), path)
    wide, tall = (float(v) for v in re.search(r'<ellipse rx="([\d.]+)" ry="([\d.]+)"', picture).groups())
    assert wide / tall == pytest.approx(2.5, rel=0.01)
    rotation = thing.world_from_object.rotation
    expected = rotation @ np.diag([0.25, 0.04, 0.01]) @ rotation.T
    np.testing.assert_allclose(position_covariance(thing), expected, atol=1e-12)


def test_without_covariance_there_is_no_ellipse(make_car, path):
    assert "<ellipse" not in birds_eye(Map((make_car(1, 8.0, 3.0, pose_covariance=None),)), path)
