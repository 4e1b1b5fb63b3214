import numpy as np
import pytest
import trimesh

from meshslam.categories import load_category
from meshslam.categories.build import build_family
from meshslam.categories.category import category_bytes
from meshslam.categories.procedural.heavy import BUSES, TRUCKS, draw_body
from meshslam.errors import CategoryError

HEAVY = ("truck", "bus")


@pytest.mark.parametrize("body", [*TRUCKS, *BUSES])
def test_a_body_has_its_published_size_and_its_key_points_on_it(body, rng):
    shapes = [draw_body(body, rng) for _ in range(6)]
    assert np.mean([s.height for s in shapes]) == pytest.approx(body.height[0], abs=1.5 * body.height[1])
    for shape in shapes:
        assert shape.length == pytest.approx(body.length[0], abs=2.6 * body.length[1] + 1.0)
        assert shape.width <= 2.55
        left = shape.keypoints()[4:]
        assert np.abs(shape.field(left)).max() < 0.02
        ends = shape.profile.min(0), shape.profile.max(0)
        np.testing.assert_allclose(ends, [[shape.rear, shape.clearance], [shape.front, shape.height]], atol=1e-9)


@pytest.mark.parametrize("name", HEAVY)
def test_the_shipped_category_is_sound(name, rng):
    category = load_category(name)
    assert category.vertices.shape == (642, 3)
    assert 1 <= len(category.modes) <= 20
    assert category.keypoint_names == load_category("car").keypoint_names
    assert trimesh.Trimesh(category.vertices, category.faces, process=False).is_watertight
    length, width, height = category.dimensions
    least, most = {"truck": (5.5, 8.0), "bus": (9.5, 12.5)}[name]
    assert least < length < most
    assert 2.0 < width < 2.7
    assert 2.2 < height < 3.6
    points = dict(zip(category.keypoint_names, category.keypoints(category.vertices), strict=True))
    assert points["left_front_light"][0] > points["left_front_wheel"][0] > 0 > points["left_back_wheel"][0]
    assert points["upper_left_windshield"][2] > points["left_front_light"][2]
    for _ in range(10):
        z = np.clip(rng.normal(size=len(category.modes)), -1, 1)
        assert trimesh.Trimesh(category.shape(z), category.faces, process=False).volume > 0.2 * length * width * height


@pytest.mark.parametrize("name", HEAVY)
def test_the_same_seed_gives_the_same_bytes(name):
    built = build_family(name, seed=2, count=5, modes=3)
    assert category_bytes(built) == category_bytes(build_family(name, seed=2, count=5, modes=3))
    assert built.name == name


@pytest.mark.parametrize("name", HEAVY)
def test_the_shipped_file_is_what_the_code_builds(name):
    built, shipped = build_family(name), load_category(name)
    np.testing.assert_array_equal(built.faces, shipped.faces)
    np.testing.assert_allclose(built.vertices, shipped.vertices, atol=1e-5)
    np.testing.assert_allclose(built.modes, shipped.modes, atol=1e-3)


def test_an_unknown_family_is_named():
    with pytest.raises(CategoryError, match=r"'boat'.*car, truck, bus"):
        build_family("boat")
