import json

import numpy as np
import pytest
import trimesh

from meshslam.categories.mesh_files import centred, read_keypoints, read_mesh, turned, upright
from meshslam.errors import CategoryError


def wedge():
    """Symmetric in y = 0 alone: low in front."""
    corners = [(x, y, z) for x in (-1.0, 1.0) for y in (-0.4, 0.4) for z in (0.0, 0.6 if x < 0 else 0.3)]
    return trimesh.convex.convex_hull(np.array(corners)).subdivide().subdivide()


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "wedge.ply"
    wedge().export(path)
    return path


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply", "off", "glb"])
def test_formats_read_alike(tmp_path, suffix):
    path = tmp_path / f"wedge.{suffix}"
    wedge().export(path)
    mesh = read_mesh(path)
    assert mesh.name == "wedge"
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [2.0, 0.8, 0.6], atol=1e-6)
    assert len(mesh.faces) == len(wedge().faces)


def test_scale_takes_the_unit_to_metres(tmp_path):
    path = tmp_path / "millimetres.stl"
    wedge().apply_scale(1000).export(path)
    with pytest.raises(CategoryError, match=r"millimetres\.stl.*2000 m.*--scale"):
        read_mesh(path)
    np.testing.assert_allclose(np.ptp(read_mesh(path, 1e-3).vertices, axis=0), [2.0, 0.8, 0.6], atol=1e-6)


def test_what_is_no_mesh_is_named(tmp_path):
    with pytest.raises(CategoryError, match=r"no mesh file at .*gone\.obj"):
        read_mesh(tmp_path / "gone.obj")
    broken = {
        "text.ply": b"no mesh",
        "empty.stl": b"",
        "odd.xyzzy": b"1 2 3",
        "points.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n",
        "wild.obj": b"v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n",
    }
    for name, content in broken.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(CategoryError, match=name.replace(".", r"\.")):
            read_mesh(tmp_path / name)


def test_axes_turn_the_mesh_and_its_key_points(saved):
    mesh = read_mesh(saved)
    there = turned(mesh, "-y", "x")
    np.testing.assert_allclose(np.ptp(there.vertices, axis=0), [0.8, 0.6, 2.0], atol=1e-6)
    volume = trimesh.Trimesh(there.vertices, there.faces, process=False).volume
    assert volume == pytest.approx(wedge().volume)  # turned, not mirrored
    with pytest.raises(CategoryError, match="one axis"):
        turned(mesh, "z", "-z")


@pytest.mark.parametrize("degrees", [0.0, 7.0, -33.0, 80.0])
def test_the_plane_of_symmetry_is_found(saved, degrees):
    mesh, angle = read_mesh(saved), np.radians(degrees)
    about_z = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    straight, note = upright(mesh.moved(about_z, np.array([5.0, 1, 2])), "auto")
    np.testing.assert_allclose(np.ptp(straight.vertices, axis=0), [2.0, 0.8, 0.6], atol=0.01)
    np.testing.assert_allclose(straight.vertices.max(0) + straight.vertices.min(0), 0, atol=1e-9)
    assert (note is None) == (degrees == 0)


def test_a_given_plane_is_taken(saved):
    mesh = read_mesh(saved)
    np.testing.assert_allclose(np.ptp(upright(mesh, "x")[0].vertices, axis=0), [0.8, 2.0, 0.6], atol=1e-6)
    np.testing.assert_allclose(upright(mesh, "y")[0].vertices, centred(mesh).vertices)


def test_what_has_no_plane_is_said(tmp_path):
    tower = trimesh.creation.box((0.6, 0.3, 1.2)).apply_translation([0.7, 0.35, 0.6])
    trimesh.util.concatenate([trimesh.creation.box((2, 1, 0.5)), tower]).export(tmp_path / "odd.ply")
    assert "no plane of symmetry" in upright(read_mesh(tmp_path / "odd.ply"), "auto")[1]


def test_key_points_go_with_their_mesh(saved, tmp_path):
    file = tmp_path / "points.json"
    file.write_text(json.dumps({"wedge": {"nose": [1.0, 0, 0.2]}, "other": {"tail": [0, 0, 0]}}))
    mesh = read_keypoints(file, [read_mesh(saved)])[0]
    np.testing.assert_allclose(centred(mesh).keypoints["nose"], [1.0, 0, -0.1], atol=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "JSON"),
        ("[1]", "expected"),
        ('{"wedge": [1, 2]}', "expected"),
        ('{"wheel": {"nose": [1, 0, 0]}}', "none of the meshes wedge"),
        ('{"wedge": {"nose": [1, 0]}}', "wedge: nose: three finite"),
        ('{"wedge": {"nose": [1, 0, NaN]}}', "wedge: nose: three finite"),
        ('{"wedge": {"nose": "left"}}', "wedge: nose: three finite"),
        ('{"wedge": {"nose": [100, 0, 0]}}', "far off the mesh"),
        ('{"wedge": {"nose": [1, 0, 0]}, "second": {"tail": [0, 0, 0]}}', "lacks key point 'nose'|lacks .*'tail'"),
    ],
)
def test_wrong_key_points_are_named(saved, tmp_path, content, message):
    file = tmp_path / "points.json"
    file.write_text(content)
    (tmp_path / "second.ply").write_bytes(saved.read_bytes())
    with pytest.raises(CategoryError, match=rf"points\.json.*({message})"):
        read_keypoints(file, [read_mesh(saved), read_mesh(tmp_path / "second.ply")])


def test_no_key_point_file_is_named(saved, tmp_path):
    with pytest.raises(CategoryError, match=r"gone\.json"):
        read_keypoints(tmp_path / "gone.json", [read_mesh(saved)])
