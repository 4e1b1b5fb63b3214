import json

import cv2
import pytest
import trimesh

from meshslam.categories import load_category
from tests.cli.conftest import done, error_of, meshslam


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    car, path = load_category("car"), tmp_path_factory.mktemp("mesh") / "mine.obj"
    trimesh.Trimesh(car.shape([0.5, -1.0]), car.faces, process=False).export(path)
    return path


@pytest.fixture(scope="module")
def category_file(mesh):
    file = mesh.with_name("mine.npz")
    assert "3 modes" in done("category", "build", "car", mesh, "--out", file).stdout
    return file


def test_a_street_is_mapped_with_a_category_of_ones_own(source, category_file, tmp_path):
    figures = json.loads(done("map", source, "--category", category_file, "--out", tmp_path / "run", "--json").stdout)
    assert figures["objects_mapped"] >= 3
    assert figures["mask_iou_shape"] > 0.9
    assert str(category_file) in (tmp_path / "run" / "config.yaml").read_text()


def test_show_draws_a_picture_or_a_page(category_file, tmp_path):
    done("category", "show", category_file, "--out", tmp_path / "mine.png")
    assert cv2.imread(str(tmp_path / "mine.png")).shape[1] == 1200
    done("category", "show", "truck", "--out", tmp_path / "truck.html")
    assert "<title>truck" in (tmp_path / "truck.html").read_text()


def test_what_is_wrong_is_named(mesh, tmp_path):
    assert "boat" in error_of(meshslam("category", "build", "boat", "--out", tmp_path / "a.npz"))
    assert "gone.obj" in error_of(meshslam("category", "build", "boat", tmp_path / "gone.obj"))
    keypoints = ("--keypoints", tmp_path / "gone.json", "--out", tmp_path / "a.npz")
    assert "gone.json" in error_of(meshslam("category", "build", "car", mesh, *keypoints))
    assert "boat" in error_of(meshslam("category", "show", "boat"))
    assert meshslam("category", "show", "car", "--out", tmp_path / "a.txt").returncode == 2
    assert meshslam("category", "build", "car", mesh, "--out", tmp_path / "a.txt").returncode == 2
    assert not list(tmp_path.glob("a.*"))
