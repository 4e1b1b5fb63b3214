"""`convert`: class names and the first frame's number are options, and what was assumed is said."""

import json

import numpy as np
import pytest

from meshslam.sequences import write_sequence_folder
from tests.cli.conftest import done, error_of, meshslam
from tests.sequences.conftest import CAMERA, FRAMES, coco_document

LINE = "0 0.2 0.2 0.5 0.2 0.5 0.6 0.2 0.6 0.9 3"


@pytest.fixture
def drive(tmp_path):
    folder = write_sequence_folder(tmp_path / "s", CAMERA, np.arange(FRAMES) * 0.1, detections=coco_document())
    (tmp_path / "labels").mkdir()
    for number in (1, 2, 3):
        (tmp_path / "labels" / f"clip_{number}.txt").write_text(LINE)
    return folder


def annotations(path):
    document = json.loads(path.read_text())
    names = {c["id"]: c["name"] for c in document["categories"]}
    return [(a["image_id"], names[a["category_id"]], a["track_id"]) for a in document["annotations"]]


def test_what_is_assumed_is_said_and_options_say_otherwise(drive, tmp_path):
    given = ("convert", "yolo", tmp_path / "labels", "--sequence", drive, "--out", tmp_path / "d.json")
    plain = done(*given)
    assert annotations(tmp_path / "d.json") == [(n, "person", 3) for n in (1, 2, 3)]
    for said in ("COCO's names (--names gives others): 0 = person (3)", "track ids", "--first-frame 1"):
        assert said in plain.stderr
    told = done(*given, "--names", "car,bus", "--first-frame", "1")
    assert annotations(tmp_path / "d.json") == [(n, "car", 3) for n in (0, 1, 2)]
    assert "--first-frame" not in told.stderr
    assert "no problem" in done("check", drive, "--detections", tmp_path / "d.json").stdout


def test_names_are_not_for_sources_with_classes_of_their_own(drive, tmp_path):
    (tmp_path / "mots.txt").write_text("")
    given = ("mots-txt", tmp_path / "mots.txt", "--sequence", drive, "--out", tmp_path / "d.json", "--names", "car")
    assert "--names" in error_of(meshslam("convert", *given))
