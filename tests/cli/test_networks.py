"""Networks, adapters and class names on the command line; what is wrong with them is one line."""

import json

import cv2
import numpy as np
import pytest

from meshslam.sequences import write_sequence_folder
from tests.cli.conftest import done, error_of, meshslam
from tests.perception.networks import colour_network, other_network
from tests.perception.test_networks import ADAPTER, own_network, painted
from tests.sequences.conftest import CAMERA, FRAMES, coco_document


@pytest.fixture
def drive(tmp_path):
    folder = write_sequence_folder(tmp_path / "s", CAMERA, np.arange(FRAMES) * 0.1)
    (folder / "images").mkdir(exist_ok=True)
    for frame in range(FRAMES):
        cv2.imwrite(str(folder / "images" / f"{frame:06d}.png"), painted(CAMERA.height, CAMERA.width)[0])
    return folder


def classes_of(path):
    document = json.loads(path.read_text())
    names = {c["id"]: c["name"] for c in document["categories"]}
    return {names[a["category_id"]] for a in document["annotations"]}


def test_an_adapter_and_class_names_are_options(drive, tmp_path):
    network = own_network(tmp_path / "net.onnx")
    (tmp_path / "a.yaml").write_text(ADAPTER.replace("[person, car]", "[person, forklift]"))
    given = ("detect", drive, "--segmenter", network, "--adapter", tmp_path / "a.yaml", "--out", tmp_path / "d.json")
    done(*given, "--no-keypoints")
    assert classes_of(tmp_path / "d.json") == {"forklift", "person"}
    told = done(*given, "--no-keypoints", "--classes", "forklift=car,person=walker")
    assert classes_of(tmp_path / "d.json") == {"car", "walker"}
    assert '"forklift" is read as "car"' in told.stderr


def test_what_is_assumed_of_a_network_is_a_note(drive, tmp_path):
    network = colour_network(tmp_path / "net.onnx", names="{0: 'vehicle', 1: 'person'}")
    said = done("detect", drive, "--segmenter", network, "--out", tmp_path / "d.json", "--no-keypoints").stderr
    assert classes_of(tmp_path / "d.json") == {"car", "person"}
    assert "RGB from 0 to 1" in said
    assert '"vehicle" is taken for car' in said


WRONG = {
    "weights": ("best.pt", (), "yolo export model=best.pt format=onnx"),
    "no file": ("no.onnx", (), "no such file"),
    "no masks": ("boxes.onnx", (), "boxes without masks"),
    "an unknown layout": ("odd.onnx", (), "others need an adapter"),
    "a class that is not there": (
        "net.onnx",
        ("--classes", "vehicel=car"),
        'no class "vehicel", there are car, person',
    ),
    "half a class": ("net.onnx", ("--classes", "vehicle"), "expected such as vehicle=car"),
    "no class": ("net.onnx", ("--classes", ","), "expected such as vehicle=car"),
    "no adapter": ("net.onnx", ("--adapter", "no.yaml"), "no.yaml: cannot be read"),
    "an adapter with an unknown key": ("net.onnx", ("--adapter", "key.yaml"), 'unknown key "clases"'),
    "an adapter of another network": ("net.onnx", ("--adapter", "other.yaml"), "the network's are output0, output1"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_networks_are_one_line(drive, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    colour_network(tmp_path / "net.onnx")
    other_network(tmp_path / "boxes.onnx", [(1, 252, 85)])
    other_network(tmp_path / "odd.onnx", [(1, 7), (1, 3, 5, 5)])
    (tmp_path / "best.pt").write_bytes(b"PK")
    (tmp_path / "key.yaml").write_text("clases: [car, person]\n")
    (tmp_path / "other.yaml").write_text(ADAPTER)
    network, options, said = WRONG[name]
    result = meshslam("detect", drive, "--segmenter", tmp_path / network, "--out", tmp_path / "d.json", *options)
    assert said in error_of(result)
    assert len(error_of(result).replace(str(tmp_path), "")) <= 310
    assert not (tmp_path / "d.json").exists()


def test_check_and_convert_take_class_names(tmp_path):
    folder = write_sequence_folder(tmp_path / "s", CAMERA, np.arange(FRAMES) * 0.1, detections=coco_document())
    names = [c["name"] for c in coco_document()["categories"]]
    assert "no problem" in done("check", folder, "--classes", f"{names[0]}=bus").stdout
    wrong = meshslam("check", folder, "--classes", "vehicel=car")
    assert wrong.returncode == 1
    assert f'no class "vehicel", there are {names[0]}' in wrong.stdout
    given = ("convert", "coco", folder / "detections.json", "--sequence", folder, "--out", tmp_path / "d.json")
    done(*given, "--classes", f"{names[0]}=bus")
    assert "bus" in classes_of(tmp_path / "d.json")
    assert 'no class "vehicel"' in error_of(meshslam(*given, "--classes", "vehicel=car"))
    assert "--tracked: coco does not use it" in error_of(meshslam(*given, "--tracked"))
    assert "--video: the file has no videos" in error_of(meshslam(*given, "--video", "a"))


@pytest.mark.parametrize("flags", [("--classes", "vehicle=car"), ("--adapter", "net.yaml")])
def test_coded_colours_take_neither_classes_nor_an_adapter(drive, tmp_path, flags):
    result = meshslam("detect", drive, "--segmenter", "colour", "--out", tmp_path / "d.json", *flags)
    assert "coded colours are read without a network: leave it out" in error_of(result)
