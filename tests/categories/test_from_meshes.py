import json

import numpy as np
import pytest
import trimesh

from meshslam.categories import load_category, save_category
from meshslam.categories.category import category_bytes
from meshslam.categories.from_meshes import MeshOptions, category_from_meshes, size_modes
from meshslam.errors import CategoryError, ConfigError
from meshslam.geometry import voxel_iou

FLIP = np.array([1.0, -1.0, 1.0])


def write_car(car, folder, name, z, points, turn=1.0):
    """A mesh file that is a shape of the shipped car, and its key points."""
    vertices = car.shape(z) * [turn, turn, 1] + [3.0, -1.0, 0.8]
    trimesh.Trimesh(vertices, car.faces, process=False).export(folder / f"{name}.ply")
    where = car.keypoints(car.shape(z)) * [turn, turn, 1] + [3.0, -1.0, 0.8]
    points[name] = dict(zip(car.keypoint_names, where.tolist(), strict=True))
    return folder / f"{name}.ply"


@pytest.fixture(scope="module")
def files(car, tmp_path_factory):
    folder, rng, points = tmp_path_factory.mktemp("cars"), np.random.default_rng(5), {}
    paths = [
        write_car(car, folder, f"car{i}", rng.normal(size=8), points, turn=-1.0 if i == 3 else 1.0) for i in range(5)
    ]
    (folder / "points.json").write_text(json.dumps(points))
    return paths, folder / "points.json", points


@pytest.fixture(scope="module")
def built(files):
    return category_from_meshes("car", files[0], files[1])


def test_one_mesh_without_key_points_is_a_category(car, files, tmp_path):
    category, _ = category_from_meshes("tram", files[0][:1])
    mesh = trimesh.load(files[0][0], process=False)
    there = category.vertices + mesh.bounds.mean(0)
    assert voxel_iou(there, category.faces, mesh.vertices, mesh.faces, 0.05) > 0.95
    assert (len(category.modes), category.keypoint_names) == (3, ())
    save_category(category, tmp_path / "tram.npz")
    assert category_bytes(load_category(tmp_path / "tram.npz")) == (tmp_path / "tram.npz").read_bytes()
    again, _ = category_from_meshes("tram", files[0][:1])
    assert category_bytes(again) == category_bytes(category)


def test_many_meshes_are_spanned_by_their_modes(files, built):
    category, _ = built
    assert len(category.modes) == 4  # one fewer than meshes, and no modes of size
    mesh = trimesh.load(files[0][1], process=False)
    points = mesh.vertices - mesh.bounds.mean(0)
    start = voxel_iou(category.vertices, category.faces, points, mesh.faces, 0.05)
    best = max(
        voxel_iou(category.shape(z), category.faces, points, mesh.faces, 0.05)
        for z in np.random.default_rng(0).normal(size=(300, 4))
    )
    assert best > start + 0.02


def test_a_mesh_that_faces_back_is_turned(built):
    assert any("car3: turned round" in note for note in built[1])
    assert not any("car1" in note for note in built[1])


def test_key_points_keep_their_places(car, files, built):
    category, _ = built
    assert category.keypoint_names == car.keypoint_names
    found = category.keypoints(category.vertices)
    turned = np.array([-1.0 if name == "car3" else 1.0 for name in files[2]])
    given = np.array([list(points.values()) for points in files[2].values()]) - [3.0, -1.0, 0.8]
    given[turned < 0] *= [-1, -1, 1]
    np.testing.assert_allclose(found, given.mean(0), atol=0.08)
    for name, point in zip(category.keypoint_names, found, strict=True):
        twin = category.keypoint_names.index(name.replace("left", "right"))
        if "left" in name:
            np.testing.assert_allclose(found[twin], point * FLIP, atol=1e-9)


def test_key_points_of_one_mesh_are_enough(files, tmp_path):
    (tmp_path / "one.json").write_text(json.dumps({"car1": files[2]["car1"]}))
    category, _ = category_from_meshes("car", files[0][:3], tmp_path / "one.json")
    assert len(category.keypoint_names) == 12
    assert len(category.modes) == 2 + 3


def test_size_modes_stretch_by_their_share(car):
    modes = size_modes(car.vertices, 0.1)
    np.testing.assert_allclose(np.ptp(car.vertices + modes[0], axis=0), np.ptp(car.vertices, axis=0) * [1.1, 1, 1])
    assert len(size_modes(car.vertices, 0.0)) == 0


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("", {}, "no category name"),
        ("../x", {}, "no category name"),
        ("car", {"scale": 0.0}, "scale"),
        ("car", {"scale": float("nan")}, "scale"),
        ("car", {"size_sigma": 0.7}, "size_sigma"),
        ("car", {"modes": -1}, "modes.*-1"),
        ("car", {"forward": "x", "up": "x"}, "one axis"),
    ],
)
def test_wrong_options_are_named(files, name, options, message):
    with pytest.raises((CategoryError, ConfigError), match=message):
        category_from_meshes(name, files[0][:1], None, MeshOptions(**options))


def test_no_mesh_or_one_twice_is_refused(files):
    with pytest.raises(CategoryError, match="at least one"):
        category_from_meshes("car", [], None, MeshOptions())
    with pytest.raises(CategoryError, match="'car0'"):
        category_from_meshes("car", files[0][:1] * 2, None, MeshOptions())


def test_a_flat_mesh_is_named(tmp_path):
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)
    sheet.export(tmp_path / "sheet.ply")
    with pytest.raises(CategoryError, match="sheet: its surface hides no volume"):
        category_from_meshes("sheet", [tmp_path / "sheet.ply"], None, MeshOptions())
