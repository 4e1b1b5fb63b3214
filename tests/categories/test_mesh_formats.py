"""Mesh files that trimesh reads wrong in silence are named; planes below and other objects are left out or said."""

import json
import struct

import numpy as np
import pytest
import trimesh

from meshslam.categories import MeshOptions, category_from_meshes
from meshslam.categories.mesh_files import axes_of, cleaned, read_mesh
from meshslam.errors import CategoryError
from tests.categories.test_mesh_files import wedge


def edited_glb(path, edit):
    """A file with its JSON changed."""
    content = path.read_bytes()
    (length,) = struct.unpack("<I", content[12:16])
    document = json.loads(content[20 : 20 + length])
    edit(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    path.write_bytes(
        content[:8]
        + struct.pack("<I", 20 + len(text) + len(rest))
        + struct.pack("<I", len(text))
        + b"JSON"
        + text
        + rest
    )
    return path


@pytest.fixture
def glb(tmp_path):
    path = tmp_path / "wedge.glb"
    wedge().export(path)
    return path


@pytest.mark.parametrize(
    "extension",
    [
        "KHR_mesh_quantization",
        "KHR_draco_mesh_compression",
        "EXT_meshopt_compression",
        "EXT_mesh_gpu_instancing",
    ],
)
def test_extensions_that_are_not_read_are_refused_by_name(glb, extension):
    edited_glb(glb, lambda d: d.update(extensionsUsed=["KHR_materials_unlit", extension]))
    with pytest.raises(CategoryError, match=rf"wedge\.glb: {extension}") as caught:
        read_mesh(glb)
    assert "scale" not in str(caught.value)


def test_integer_vertices_sparse_values_and_fans_are_refused(glb, tmp_path):
    content = glb.read_bytes()

    def position(document):
        return document["accessors"][document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]

    for edit, said in (
        (lambda d: position(d).update(componentType=5122, normalized=True), "vertices of integers"),
        (lambda d: position(d).update(sparse={"count": 1}), "sparse"),
        (lambda d: d["meshes"][0]["primitives"][0].update(mode=6), "triangle fans"),
        (lambda d: d["meshes"][0]["primitives"][0].update(mode=5), "triangle strips"),
    ):
        glb.write_bytes(content)
        with pytest.raises(CategoryError, match=said):
            read_mesh(edited_glb(glb, edit))
    glb.write_bytes(content)
    assert len(read_mesh(edited_glb(glb, lambda d: d.update(extensionsUsed=["KHR_materials_unlit"]))).faces)


def test_damaged_gltf_is_named(glb, tmp_path):
    content = glb.read_bytes()
    for damaged in (content[:18], content[:40], b"glTF" + bytes(40), content.replace(b"{", b"[", 1)):
        glb.write_bytes(damaged)
        with pytest.raises(CategoryError, match=r"wedge\.glb"):
            read_mesh(glb)
    (tmp_path / "deep.gltf").write_text("[" * 100_000)
    with pytest.raises(CategoryError, match=r"deep\.gltf") as caught:
        read_mesh(tmp_path / "deep.gltf")
    assert len(str(caught.value)) < 400


def test_gltf_is_y_up_and_its_longer_side_is_ahead(tmp_path):
    z_up = wedge()
    along_x = z_up.copy()
    along_x.apply_transform([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    along_z = along_x.copy()
    along_z.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    for mesh, ahead in ((along_x, "x"), (along_z, "z")):
        mesh.export(tmp_path / "car.glb")
        read = read_mesh(tmp_path / "car.glb")
        forward, up, said = axes_of(read, tmp_path / "car.glb", "auto", "auto")
        assert (forward, up) == (ahead, "y")
        assert "y is up" in said
        category = category_from_meshes("car", [tmp_path / "car.glb"], None, MeshOptions(modes=0))[0]
        assert np.allclose(category.dimensions, [2.0, 0.8, 0.6], atol=0.05)
    assert axes_of(read, tmp_path / "car.obj", "auto", "auto") == ("x", "z", None)
    assert axes_of(read, tmp_path / "car.glb", "y", "z") == ("y", "z", None)


def test_a_shadow_plane_is_left_out_and_said(tmp_path):
    plane = trimesh.Trimesh([[-1.3, -0.7, 0], [1.3, -0.7, 0], [1.3, 0.7, 0], [-1.3, 0.7, 0]], [[0, 1, 2], [0, 2, 3]])
    trimesh.util.concatenate([wedge(), plane]).export(tmp_path / "car.ply")
    mesh, said = cleaned(read_mesh(tmp_path / "car.ply"), "z")
    assert np.allclose(np.ptp(mesh.vertices, axis=0), [2.0, 0.8, 0.6])
    assert "shadow plane" in said[0]
    sound, nothing = cleaned(read_mesh_of(wedge(), tmp_path), "z")
    assert len(sound.faces) == len(wedge().faces)
    assert nothing == []


def test_several_objects_in_one_file_are_said_and_parts_of_one_are_not(tmp_path):
    other = wedge().apply_translation([0, 2.0, 0])
    assert "2 objects" in cleaned(read_mesh_of(trimesh.util.concatenate([wedge(), other]), tmp_path), "z")[1][0]
    wheel = trimesh.creation.icosphere(radius=0.1).apply_translation([0.9, 0.42, 0.1])
    assert cleaned(read_mesh_of(trimesh.util.concatenate([wedge(), wheel]), tmp_path), "z")[1] == []


def read_mesh_of(mesh, folder):
    mesh.export(folder / "some.ply")
    return read_mesh(folder / "some.ply")


def test_the_unit_of_a_file_is_guessed(tmp_path):
    for scale, said in ((1000, r"for millimetres it is 0\.001"), (100, r"for centimetres it is 0\.01")):
        wedge().apply_scale(2 * scale).export(tmp_path / "car.stl")
        with pytest.raises(CategoryError, match=said):
            read_mesh(tmp_path / "car.stl")
