import numpy as np
import pytest
import trimesh

from meshslam.categories.shrinkwrap import FLIP, Wrapper, carry
from meshslam.categories.spheres import icosphere


@pytest.fixture(scope="module")
def wrapper() -> Wrapper:
    return Wrapper(icosphere(2))


def egg(points):
    return np.linalg.norm(points / [2.0, 1.0, 0.8] + [0.1, 0, 0], axis=1) - 1


def mesh_volume(wrapper, vertices):
    return trimesh.Trimesh(vertices, wrapper.sphere.faces, process=False).volume


def test_the_basis_spans_exactly_the_symmetric_meshes(wrapper, rng):
    basis, mirror = wrapper.symmetry, wrapper.sphere.mirror
    pairs, plane = (len(mirror) - len(wrapper.sphere.plane)) // 2, len(wrapper.sphere.plane)
    assert basis.shape == (3 * len(mirror), 3 * pairs + 2 * plane)
    moved = (basis @ rng.normal(size=basis.shape[1])).reshape(-1, 3)
    np.testing.assert_array_equal(moved[mirror] * FLIP, moved)


def test_a_fit_keeps_symmetry_and_volume(wrapper):
    fitted = wrapper.fit(egg, wrapper.sphere.vertices * [1.8, 1.1, 0.9] - [0.2, 0, 0], smoothness=0.05)
    np.testing.assert_array_equal(fitted[wrapper.sphere.mirror] * FLIP, fitted)
    assert mesh_volume(wrapper, fitted) == pytest.approx(4 / 3 * np.pi * 2.0 * 0.8, rel=0.01)
    inscribed = wrapper.sphere.vertices * [2.0, 1.0, 0.8]
    assert mesh_volume(wrapper, inscribed) < 0.98 * mesh_volume(wrapper, fitted)


def test_a_fitted_mesh_stays_where_it_is(wrapper):
    fitted = wrapper.fit(egg, wrapper.sphere.vertices * [2.0, 1.0, 0.8] - [0.2, 0, 0], iterations=12)
    again = wrapper.fit(egg, fitted)
    assert np.abs(again - fitted).max() < 0.01


def test_relaxing_gathers_vertices_where_the_density_is_high(wrapper):
    start = wrapper.sphere.vertices * [2.0, 1.0, 0.8] - [0.2, 0, 0]
    relaxed = wrapper.relax(egg, start, lambda p: np.where(p[:, 0] > 0.8, 8.0, 1.0), 60)
    assert (relaxed[:, 0] > 0.8).sum() > 1.3 * (start[:, 0] > 0.8).sum()
    assert np.abs(egg(relaxed)).max() < 0.01


def test_landmarks_carry_an_affine_map_exactly(rng):
    marks, points = rng.normal(size=(20, 3)), rng.normal(size=(50, 3))
    matrix, shift = np.eye(3) + 0.3 * rng.normal(size=(3, 3)), rng.normal(size=3)
    np.testing.assert_allclose(carry(points, marks, marks @ matrix + shift), points @ matrix + shift, atol=1e-6)


def test_landmarks_take_their_neighbourhood_along(rng):
    marks = rng.normal(size=(30, 3))
    moved = marks + 0.1 * rng.normal(size=(30, 3))
    np.testing.assert_allclose(carry(marks, marks, moved), moved, atol=0.01)
