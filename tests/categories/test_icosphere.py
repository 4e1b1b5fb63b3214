import numpy as np
import pytest

from meshslam.categories.spheres import edges_of, icosphere, subdivide
from meshslam.errors import CategoryError


@pytest.mark.parametrize("level", range(5))
def test_counts_follow_the_subdivisions(level):
    sphere = icosphere(level)
    assert len(sphere.vertices) == 10 * 4**level + 2
    assert len(sphere.faces) == 20 * 4**level
    assert len(edges_of(sphere.faces)) == 30 * 4**level


@pytest.mark.parametrize("level", range(4))
def test_closed_outward_unit_sphere(level):
    sphere = icosphere(level)
    np.testing.assert_allclose(np.linalg.norm(sphere.vertices, axis=1), 1, atol=1e-12)
    a, b, c = (sphere.vertices[sphere.faces[:, i]] for i in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0).all()
    directed = sphere.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert {tuple(e) for e in directed} == {tuple(e[::-1]) for e in directed}
    assert len({tuple(e) for e in directed}) == len(directed)


@pytest.mark.parametrize("level", range(4))
def test_mirror_maps_the_mesh_onto_itself(level):
    sphere = icosphere(level)
    mirror = sphere.mirror
    np.testing.assert_array_equal(mirror[mirror], np.arange(len(mirror)))
    np.testing.assert_array_equal(sphere.vertices[mirror] * [1, -1, 1], sphere.vertices)
    mirrored = {tuple(sorted(f)) for f in mirror[sphere.faces]}
    assert mirrored == {tuple(sorted(f)) for f in sphere.faces}
    np.testing.assert_array_equal(sphere.vertices[sphere.plane, 1], 0)


def test_the_plane_holds_32_of_642():
    sphere = icosphere(3)
    assert (len(sphere.vertices), len(sphere.faces), len(sphere.plane)) == (642, 1280, 32)


def test_subdivision_keeps_the_surface(rng):
    vertices, faces = rng.normal(size=(3, 3)), np.array([[0, 1, 2]])
    finer, split = subdivide(vertices, faces)
    np.testing.assert_array_equal(finer[:3], vertices)

    def area_vector(v, f):
        return np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]]).sum(0)

    np.testing.assert_allclose(area_vector(finer, split), area_vector(vertices, faces), atol=1e-12)


@pytest.mark.parametrize("level", [-1, 7])
def test_a_wild_level_is_refused(level):
    with pytest.raises(CategoryError, match=str(level)):
        icosphere(level)
