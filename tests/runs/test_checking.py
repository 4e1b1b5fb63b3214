"""`check` lists what runs refuse, and calls nothing else a problem: both read detections with one reader."""

import json

import numpy as np
import pytest

from meshslam.errors import DetectionError
from meshslam.perception import read_recorded_detections
from meshslam.runs.checking import detection_problems
from meshslam.sequences import RecordingOptions, inspect_sequence, open_sequence, write_sequence_folder
from tests.sequences.conftest import CAMERA, FRAMES, coco_document


@pytest.fixture
def folder(tmp_path):
    """A sequence folder with detections alone."""
    return write_sequence_folder(tmp_path / "s", CAMERA, np.arange(FRAMES) * 0.1, detections=coco_document())


def check_recording(folder, detections_path=None):
    """What `check` says of files, without its judgements."""
    recording, problems = inspect_sequence(folder, RecordingOptions(detections_path=detections_path))
    return [*problems, *detection_problems(folder, detections_path, recording)]


def changed(**changes):
    document = coco_document()
    document["annotations"][2] |= changes
    return document


def without(key):
    document = coco_document()
    del document[key]
    return document


def with_category(**changes):
    document = coco_document()
    document["categories"][0] |= changes
    return document


def with_image(**changes):
    document = coco_document()
    document["images"][1] |= changes
    return document


THIRD = "annotations[2] (id 3)"
REFUSED = [
    (without("images"), "images: is missing, expected a list"),
    (without("categories"), "categories: is missing"),
    (without("annotations"), "annotations: is missing"),
    (coco_document() | {"annotations": {}}, "annotations: found an object, expected a list"),
    ([], "found a list, expected an object"),
    (changed(image_id=99), f"{THIRD}: image_id: found 99"),
    (changed(image_id=[0]), f"{THIRD}: image_id: found [0]"),
    (changed(image_id=1.0), f"{THIRD}: image_id: found 1.0"),
    (changed(category_id=5), f"{THIRD}: category_id: found 5"),
    (changed(category_id=[1]), f"{THIRD}: category_id: found [1]"),
    (changed(category_id={}), f"{THIRD}: category_id: found {{}}"),
    (changed(id=1), "annotations[2] (id 1): id: 1 is used twice"),
    (changed(id=-4), "annotations[2] (id -4): id: found -4"),
    (changed(id=10**400), "found 1000"),
    (changed(track_id="x"), f'{THIRD}: track_id: found "x"'),
    (changed(bbox=[1.0, 2.0, 3.0]), f"{THIRD}: bbox: found [1.0, 2.0, 3.0]"),
    (changed(bbox=[1e308, 2.0, 1e308, 3.0]), f"{THIRD}: bbox: found 1e+308"),
    (changed(keypoints=[1.0, 2.0, 2]), f"{THIRD}: keypoints: found 3 numbers"),
    (changed(score="high"), f"{THIRD}: score"),
    (changed(segmentation=[[-5000, 10, 50, 50, 60, 80]]), "far outside"),
    (changed(segmentation={"size": [64, 48], "counts": [3072]}), f"{THIRD}: segmentation: has size"),
    (changed(segmentation={"size": [48, 64], "counts": "d0"}), f"{THIRD}: segmentation: has counts"),
    (with_category(keypoints=["a", "a"]), "categories[0] (id 1): keypoints"),
    (with_category(name=None), "categories[0] (id 1): name"),
    (with_category(name="\ud800"), "categories[0] (id 1): name"),
    (with_image(file_name=5), "images[1] (id 1): file_name: found 5"),
    (with_image(width=64.0), "images[1] (id 1): width: found 64.0"),
    (with_image(width=65), "images id 1: is 65x48, the camera's is 64x48"),
    (with_image(id=9, file_name="x.png"), "images id 9: no frame of that number; frames are 0 to 4"),
]


@pytest.mark.parametrize(("document", "message"), REFUSED)
def test_what_runs_refuse_is_listed_with_the_same_words(folder, document, message):
    (folder / "detections.json").write_text(json.dumps(document))
    lines = [str(p) for p in check_recording(folder) if p.severity == "problem"]
    assert any(message in line for line in lines), lines
    with pytest.raises(DetectionError) as caught:
        read_recorded_detections(folder / "detections.json", open_sequence(folder))
    assert str(caught.value) in lines
    assert all("\n" not in line and len(line.removeprefix(str(folder))) < 300 for line in lines)


HANDLED = [
    (changed(track_id=-1), None),
    (changed(bbox=None), None),
    (changed(keypoints=[]), None),
    (changed(score=1.0001), "confidences above 1"),
    (changed(bbox=[1, 1, 0, 5]), "bbox is not x, y, width, height of the mask"),
    (with_category(name="CAR"), 'category "CAR" is read as "car"'),
    (
        with_category(name="tree"),
        "no detection has a class that is tracked (tracking.categories: bus, car, truck): fou",
    ),
]


@pytest.mark.parametrize(("document", "note"), HANDLED)
def test_what_runs_handle_is_a_note_at_most(folder, document, note):
    (folder / "detections.json").write_text(json.dumps(document))
    read_recorded_detections(folder / "detections.json", open_sequence(folder))
    found = check_recording(folder)
    assert [p.severity for p in found] == ([] if note is None else ["note"])
    assert note is None or note in found[0].what


def test_a_byte_order_mark_is_no_problem(folder):
    for name in ("detections.json", "times.txt", "camera.yaml"):
        (folder / name).write_bytes(b"\xef\xbb\xbf" + (folder / name).read_bytes())
    assert check_recording(folder) == []
    assert len(open_sequence(folder)) == FRAMES


def test_every_problem_of_a_file_is_listed_once(folder):
    document = coco_document()
    document["images"][4]["width"] = 0
    document["annotations"][0] |= {"bbox": [], "score": -1}
    document["annotations"][1]["category_id"] = 4
    (folder / "detections.json").write_text(json.dumps(document))
    found = [(p.where, p.what.split(":")[0]) for p in check_recording(folder)]
    assert found == [
        ("images[4] (id 4)", "width, height"),
        ("annotations[0] (id 1)", "score"),
        ("annotations[0] (id 1)", "bbox"),
        ("annotations[1] (id 2)", "category_id"),
    ]


def test_detections_are_checked_where_the_recording_cannot_be_read(folder):
    (folder / "camera.yaml").unlink()
    (folder / "detections.json").write_text("{")
    assert {p.file.name for p in check_recording(folder)} == {"camera.yaml", "detections.json"}


def test_given_detections_take_the_place_of_the_folders_own(folder, tmp_path):
    assert check_recording(folder, tmp_path / "nothing.json")[-1].file.name == "nothing.json"
