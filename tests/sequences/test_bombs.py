"""Small files that claim far more than they hold are refused in one line, before anything is unpacked."""

import resource
import zipfile

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import CategoryError, DetectionError, GeometryError, SequenceError
from meshslam.geometry import Camera
from meshslam.perception import read_detections
from meshslam.sequences.distortion import Distortion
from meshslam.sequences.text import numbers_of, read_yaml


def refused(path, text, said):
    path.write_text(text)
    with pytest.raises(SequenceError, match=said) as caught:
        [numbers_of(path, key, value) for key, value in read_yaml(path).items()]
    assert len(str(caught.value).removeprefix(str(path))) <= 300
    assert "\n" not in str(caught.value)


def bomb(levels=9, width=9):
    lines = ["a0: &a0 [" + ", ".join(["1"] * width) + "]"]
    lines += [f"a{i}: &a{i} [" + ", ".join([f"*a{i - 1}"] * width) + "]" for i in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (bomb(), "line 4: more than 24 aliases"),
        ("a: " + "[" * 3000, "not valid YAML|nested too deeply"),
        ("a: " + "9" * 10_000, "not valid YAML: Exceeds the limit"),
        ("a: 2001-99-99", "not valid YAML: month must be in"),
        ("a: 2001-01-01", "expected numbers, found datetime.date"),
        ("a: &a [*a]", "expected numbers"),
        ("a: {rows: .inf, cols: 1, data: [1]}", "expected numbers"),
        ("a: [" + ", ".join(["x" * 50] * 1000) + "]", "expected numbers, found"),
        ("2001-01-01: x\n1: y", "2001-01-01: expected numbers"),
    ],
)
def test_yaml_is_refused_in_one_line(tmp_path, text, said):
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refused(tmp_path / "camera.yaml", text, said)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 200_000


def test_some_aliases_are_read(tmp_path):
    (tmp_path / "camera.yaml").write_text("a: &a [1, 2]\nb: *a\nc: [*a, *a]\n")
    assert read_yaml(tmp_path / "camera.yaml")["c"] == [[1, 2], [1, 2]]


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a": ' + "9" * 10_000 + "}", "{"])
def test_json_is_refused_in_one_line(tmp_path, text):
    (tmp_path / "detections.json").write_text(text)
    with pytest.raises(DetectionError, match="JSON") as caught:
        read_detections(tmp_path / "detections.json")
    assert "\n" not in str(caught.value)


def test_a_category_that_says_it_unpacks_to_gigabytes_is_not_unpacked(tmp_path):
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name in range(4):
            archive.writestr(f"{name}.npy", bytes(70 << 20))
    with pytest.raises(CategoryError, match="says it unpacks to 293601280 bytes"):
        load_category(str(tmp_path / "bomb.npz"))


def test_a_camera_of_billions_of_pixels_is_not_undistorted():
    camera = Camera(60_000, 60_000, fx=3e4, fy=3e4, cx=3e4, cy=3e4)
    with pytest.raises(GeometryError, match="3600000000 pixels"):
        Distortion(camera, camera, np.array([-0.1, 0.01, 0.0, 0.0]))
