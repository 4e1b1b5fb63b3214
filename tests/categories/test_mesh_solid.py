import numpy as np
import pytest
import trimesh

from meshslam.categories.mesh_solid import MeshSolid, surface_points
from meshslam.errors import CategoryError


def solid_of(mesh):
    return MeshSolid(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64))


@pytest.fixture(scope="module")
def ball():
    return trimesh.creation.icosphere(3, 1.0)


def inside_volume(solid):
    return float((solid.field.table < 0).sum()) * solid.cell**3


def test_the_field_is_the_distance_to_the_surface(ball, rng):
    solid = solid_of(ball)
    points = rng.normal(size=(400, 3))
    points *= (rng.uniform(0.9, 1.15, 400) / np.linalg.norm(points, axis=1))[:, None]
    true = -trimesh.proximity.signed_distance(ball, points)
    np.testing.assert_allclose(solid.field(points), true, atol=0.6 * solid.cell)
    assert abs(solid.field(np.asarray(trimesh.sample.sample_surface(ball, 500, seed=0)[0])).mean()) < 0.1 * solid.cell


def test_far_points_are_far(ball):
    solid = solid_of(ball)
    far = np.array([[5.0, 0, 0], [0, -7.0, 3.0]])
    np.testing.assert_allclose(solid.field(far), np.linalg.norm(far, axis=1) - 1, rtol=0.05)


@pytest.mark.parametrize("damage", ["flipped", "inner wall", "doubled", "crack", "hole", "no bottom"])
def test_damage_leaves_the_volume(ball, damage, rng):
    mesh = ball.copy()
    centres = mesh.triangles_center
    if damage == "flipped":
        flip = rng.random(len(mesh.faces)) < 0.5
        mesh.faces = np.where(flip[:, None], mesh.faces[:, ::-1], mesh.faces)
    elif damage == "inner wall":
        mesh = trimesh.util.concatenate([mesh, trimesh.creation.box((0.9, 0.9, 0.01))])
    elif damage == "doubled":
        mesh = trimesh.util.concatenate([mesh, mesh])
    elif damage == "crack":  # the faces come apart
        mesh.unmerge_vertices()
        mesh.vertices = mesh.vertices + np.repeat(rng.normal(size=(len(mesh.faces), 3)) * 0.005, 3, axis=0)
    elif damage == "hole":
        mesh.update_faces(centres @ [0.6, 0.0, 0.8] < 0.95)
    else:
        mesh.update_faces(centres[:, 2] > -0.8)
    lost = 0.02 if damage != "no bottom" else 0.08  # below the rim nothing is hidden
    assert inside_volume(solid_of(mesh)) == pytest.approx(ball.volume, rel=lost)
    assert solid_of(mesh).leaks == (damage in ("hole", "no bottom"))


@pytest.mark.parametrize("faces", [[[0, 1, 2]], [[0, 1, 2], [0, 2, 3]]])
def test_a_flat_mesh_hides_nothing(faces):
    corners = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0.01], [0, 1, 0]])
    with pytest.raises(CategoryError, match="hides no volume"):
        _ = MeshSolid(corners, np.array(faces)).field


def test_a_closing_grows_and_fills_what_is_narrow():
    bodies = [trimesh.creation.box((1, 1, 1)).apply_translation([x, 0, 0]) for x in (-0.6, 0.6)]
    solid = solid_of(trimesh.util.concatenate(bodies))
    between = np.zeros((1, 3))
    assert solid.field(between)[0] > 0
    assert solid.closed(0.3)(between)[0] < 0
    grid = np.random.default_rng(0).uniform(-1, 1, (500, 3))
    assert (solid.closed(0.3)(grid) <= solid.field(grid) + 2 * solid.cell).all()


def test_surface_points_leave_no_gap():
    mesh = trimesh.creation.box((2.0, 1.0, 0.5))
    points = surface_points(np.asarray(mesh.vertices), np.asarray(mesh.faces), 0.1)
    probes = np.asarray(trimesh.sample.sample_surface(mesh, 2000, seed=0)[0])
    gap = np.linalg.norm(probes[:, None] - points, axis=2).min(1)
    assert gap.max() < 0.1
    assert trimesh.proximity.closest_point(mesh, points)[1].max() < 1e-9
