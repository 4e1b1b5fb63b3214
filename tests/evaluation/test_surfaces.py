import numpy as np
import pytest
import trimesh

from meshslam.evaluation.surfaces import distances_to_surface, sampled, surface_distances


def test_distances_are_those_of_an_exact_search(car, rng):
    points = rng.uniform(-3, 3, (200, 3))
    mesh = trimesh.Trimesh(car.vertices, car.faces, process=False)
    exact = trimesh.proximity.closest_point(mesh, points)[1]
    ours = distances_to_surface(points, car.vertices, car.faces)
    assert (ours >= exact - 1e-9).all()
    assert np.abs(ours - exact).max() < 5e-3
    near = trimesh.sample.sample_surface(mesh, 500, seed=1)[0] + rng.normal(0, 0.05, (500, 3))
    exact = trimesh.proximity.closest_point(mesh, near)[1]
    assert np.abs(distances_to_surface(near, car.vertices, car.faces) - exact).mean() < 1e-6


def test_the_same_surface_is_perfect_however_it_is_cut_into_faces(car):
    finer = trimesh.Trimesh(car.vertices, car.faces, process=False).subdivide()
    for vertices, faces in ((car.vertices, car.faces), (np.asarray(finer.vertices), np.asarray(finer.faces))):
        found = surface_distances(car.vertices, car.faces, vertices, faces)
        assert found.chamfer_m < 1e-6
        assert found.f_score() == 1.0


def test_known_answers_of_two_boxes():
    """A cube of 1 m, and one of 1.2 m around it: all points of the inner are 0.1 m away."""
    inner, outer = trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1.2, 1.2, 1.2))
    found = surface_distances(inner.vertices, inner.faces, outer.vertices, outer.faces)
    np.testing.assert_allclose(found.from_truth_m, 0.1, atol=1e-9)
    assert found.from_estimate_m.min() >= 0.1 - 1e-9  # its corners are 0.17 m away
    assert found.chamfer_m == pytest.approx((0.1 + found.from_estimate_m.mean()) / 2)
    assert (found.f_score(0.05), found.f_score(0.2)) == (0.0, 1.0)


def test_points_are_spread_by_area(car):
    box = trimesh.creation.box((4, 1, 1))
    points = sampled(box.vertices, box.faces, 9000)
    ends = np.isclose(np.abs(points[:, 0]), 2.0, atol=1e-9).mean()
    assert ends == pytest.approx(2 / 18, abs=0.01)
    np.testing.assert_array_equal(points, sampled(box.vertices, box.faces, 9000))


def test_chamfer_knows_no_order_and_no_place(car, rng):
    other = 1.1 * car.vertices + rng.normal(0, 0.01, car.vertices.shape)
    one = surface_distances(car.vertices, car.faces, other, car.faces)
    two = surface_distances(other, car.faces, car.vertices, car.faces)
    assert one.chamfer_m == pytest.approx(two.chamfer_m)
    assert one.f_score() == pytest.approx(two.f_score())
