import numpy as np
import pytest

from meshslam.categories.procedural.solid import (
    cast,
    curve_distance,
    distance_and_normal,
    project,
    smooth_max,
    smooth_min,
)


def ball(points):
    return np.linalg.norm(points, axis=1) - 1.5


def test_smooth_extremes_bound_and_meet_the_sharp_ones(rng):
    a, b = rng.normal(size=(2, 500))
    rounded = smooth_max(a, b, 0.3)
    assert (rounded >= np.maximum(a, b)).all()
    assert (rounded <= np.maximum(a, b) + 0.3 / 4 + 1e-12).all()
    far = np.abs(a - b) > 0.3
    np.testing.assert_array_equal(rounded[far], np.maximum(a, b)[far])
    np.testing.assert_allclose(smooth_min(a, b, 0.3), -smooth_max(-a, -b, 0.3))


def test_distance_normal_and_projection_of_a_ball(rng):
    points = rng.normal(size=(200, 3)) + 0.1
    distance, normal = distance_and_normal(lambda p: 3 * ball(p), points)  # the slope is taken out
    np.testing.assert_allclose(distance, ball(points), atol=1e-4)
    np.testing.assert_allclose(normal, points / np.linalg.norm(points, axis=1, keepdims=True), atol=1e-4)
    np.testing.assert_allclose(ball(project(ball, points, 12)), 0, atol=1e-6)


def test_rays_end_on_the_surface(rng):
    starts, directions = rng.uniform(-0.5, 0.5, (20, 3)), rng.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ends = cast(ball, starts, directions)
    np.testing.assert_allclose(ball(ends), 0, atol=1e-6)
    assert (((ends - starts) * directions).sum(1) > 0).all()


@pytest.mark.parametrize("sides", [4, 60])
def test_curve_distance_of_regular_polygons(rng, sides):
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    corners = np.stack([np.cos(angle), np.sin(angle)], 1)
    points = rng.uniform(-1.6, 1.6, (300, 2))
    found = curve_distance(points, corners)
    normal_angle = angle + np.pi / sides
    lines = points @ np.stack([np.cos(normal_angle), np.sin(normal_angle)]) - np.cos(np.pi / sides)
    inside = lines.max(1) < 0
    np.testing.assert_array_equal(found < 0, inside)
    np.testing.assert_allclose(found[inside], lines.max(1)[inside], atol=3e-3)
    assert (found[~inside] >= lines.max(1)[~inside] - 3e-3).all()
