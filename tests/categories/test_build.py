import numpy as np
import pytest

from meshslam.categories.build import build_car
from meshslam.categories.category import category_bytes
from meshslam.categories.keypoints import point_weights
from meshslam.categories.modes import principal_modes
from meshslam.errors import CategoryError


def test_the_same_seed_gives_the_same_bytes(small_car):
    assert category_bytes(build_car(seed=3, count=8, modes=4)) == category_bytes(small_car)


def test_another_seed_gives_another_category(small_car):
    other = build_car(seed=4, count=6, modes=2)
    assert len(other.modes) == 2
    assert np.abs(other.vertices - small_car.vertices).max() > 0.01
    np.testing.assert_array_equal(other.faces, small_car.faces)


@pytest.mark.parametrize(("count", "modes"), [(3, 3), (0, 1), (5, 0)])
def test_too_few_cars_are_refused(count, modes):
    with pytest.raises(CategoryError, match=f"count={count}"):
        build_car(count=count, modes=modes)


def sphere_shapes(rng, count):
    from meshslam.categories.spheres import icosphere

    sphere = icosphere(1)
    basis = rng.normal(size=(3, *sphere.vertices.shape)) * 0.05
    z = rng.normal(size=(count, 3)) * [2.0, 1.0, 0.5]
    return sphere, sphere.vertices + np.tensordot(z, basis, 1)


def test_modes_span_the_shapes_and_carry_their_variance(rng):
    sphere, shapes = sphere_shapes(rng, 40)
    mean, modes = principal_modes(shapes, sphere.faces, 8)
    assert len(modes) == 3  # no more than there are: the others are noise
    flat = modes.reshape(3, -1)
    weights = np.linalg.lstsq(flat.T, (shapes - mean).reshape(40, -1).T, rcond=None)[0]
    np.testing.assert_allclose(flat.T @ weights, (shapes - mean).reshape(40, -1).T, atol=1e-9)
    np.testing.assert_allclose(np.cov(weights), np.eye(3), atol=1e-8)


def test_fewer_modes_are_the_first_of_more(rng):
    sphere, shapes = sphere_shapes(rng, 40)
    np.testing.assert_allclose(
        principal_modes(shapes, sphere.faces, 2)[1], principal_modes(shapes, sphere.faces, 3)[1][:2], atol=1e-10
    )


def test_weights_find_points_that_are_sums_of_vertices(rng):
    _, shapes = sphere_shapes(rng, 20)
    true = np.zeros((2, shapes.shape[1]))
    true[0, [3, 7]] = [0.3, 0.7]
    true[1, 11] = 1.0
    found = point_weights(shapes, true @ shapes, candidates=shapes.shape[1])
    np.testing.assert_allclose(found.sum(1), 1, atol=1e-12)
    np.testing.assert_allclose(found @ shapes, true @ shapes, atol=1e-3)
