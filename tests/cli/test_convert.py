"""`convert`: class names and the first frame's number are options, and what was assumed is said."""

import json

import cv2
import numpy as np
import pytest

from meshslam.cli.convert import Source
from meshslam.perception import encode_mask
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


@pytest.mark.parametrize("flag", ["--names", "--yolo", "--video"])
def test_options_of_other_sources_are_refused(drive, tmp_path, flag):
    value = {"--names": "car", "--yolo": "boxes", "--video": "a"}[flag]
    given = ("openpifpaf", tmp_path, "--sequence", drive, "--out", tmp_path / "d.json", flag, value)
    assert f"{flag}: openpifpaf does not use it" in error_of(meshslam("convert", *given))


def mots(tmp_path):
    """Two tracks of the classes 1 and 4 in frames 0 and 1, and a region to ignore; as text and as pictures."""
    lines, folder = [], tmp_path / "png"
    folder.mkdir()
    for frame in (0, 1):
        picture = np.zeros((CAMERA.height, CAMERA.width), np.uint16)
        for number, x in ((1001, 4), (4002, 20), (10000, 40)):
            picture[10:30, x : x + 12] = number
            code = encode_mask((picture == number).astype(np.uint8))
            lines.append(f"{frame} {number} {number // 1000} {CAMERA.height} {CAMERA.width} {code['counts']}")
        cv2.imwrite(str(folder / f"{frame:06d}.png"), picture)
    (tmp_path / "mots.txt").write_text("\n".join(lines))
    return {"mots-txt": tmp_path / "mots.txt", "mots-png": folder}


@pytest.mark.parametrize("source", ["mots-txt", "mots-png"])
def test_mots_classes_are_named_and_tracks_kept(drive, tmp_path, source):
    given = ("convert", source, mots(tmp_path)[source], "--sequence", drive, "--out", tmp_path / "d.json")
    assert "class 4: the names are 1 car, 2 person, and 10 is ignored: --names says" in error_of(meshslam(*given))
    told = done(*given, "--names", "1=van,4=bus", "--classes", "van=car")
    assert "class numbers are read by the names given: 1 = van (2), 4 = bus (2)" in told.stderr
    both = [(0, "car", 1001), (0, "bus", 4002), (1, "car", 1001), (1, "bus", 4002)]
    assert annotations(tmp_path / "d.json") == both
    done(*given, "--names", "car,person,tram,bus")  # a list counts from 1
    assert annotations(tmp_path / "d.json") == both
    done(*given, "--names", "1=car,4=bus,10=tram")  # 10 is a class where it has a name
    assert [row for row in annotations(tmp_path / "d.json") if row[1] == "tram"] == [
        (0, "tram", 10000),
        (1, "tram", 10000),
    ]
    assert "no problem" in done("check", drive, "--detections", tmp_path / "d.json").stdout


def test_the_help_has_an_example_of_every_source():
    shown = " ".join(done("convert", "--help").stdout.replace("│", " ").split())
    for source in Source:
        assert f"Example: meshslam convert {source.value} " in shown, source
        assert " ".join(done("convert", source.value, "--help").stdout.replace("│", " ").split()) == shown
