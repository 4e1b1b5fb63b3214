"""Numbers in other tools' files: frames that count from 1, track ids at the ends of lines, classes of one's own."""

import json

import numpy as np
import pytest

from meshslam.errors import DetectionError
from meshslam.perception import (
    ImageFrames,
    counted_from_one,
    encode_mask,
    from_coco_results,
    from_mots_txt,
    from_yolo_txt,
    read_class_names,
    read_detections,
    write_detections,
)

FRAMES = ImageFrames((0, 1, 2, 3), 1242, 375)
POLYGON = "0.483092 0.480000 0.563607 0.480000 0.563607 0.560000 0.483092 0.560000"
AT_BORDER = "0.1 0.9 0.2 0.9 0.2 1 0.1 1"
COUNTS = encode_mask(np.pad(np.ones((8, 8), np.uint8), 10))["counts"]


@pytest.fixture
def yolo(tmp_path):
    def read(files, frames=FRAMES, **options):
        for name, text in files.items():
            (tmp_path / name).write_text(text)
        return from_yolo_txt(tmp_path, frames, **options)

    return read


def rows_of(found):
    return [(d.frame, d.area_px, d.score, d.track_id) for d in found.detections]


TRACKED = {
    f"2 {POLYGON} 0.74 1": (0.74, 1),
    f"2 {POLYGON} 0.74 2": (0.74, 2),
    f"2 {POLYGON} 1": (1.0, 1),
    f"2 {POLYGON} 2": (1.0, 2),
    f"2 {POLYGON} 0.74": (0.74, None),
    f"2 {POLYGON} 1.0": (1.0, None),
    f"2 {POLYGON} 0": (0.0, None),
    f"2 {POLYGON}": (1.0, None),
}


@pytest.mark.parametrize("line", TRACKED)
def test_the_last_numbers_of_a_line_are_confidence_and_track(yolo, line):
    score, track = TRACKED[line]
    found = yolo({"000000.txt": f"\ufeff{line}  \n\n  \n"})
    assert rows_of(found) == [(0, 3000, score, track)]
    assert any("track ids" in note for note in found.warnings) == (track is not None)


def test_a_point_at_the_images_border_is_no_track(yolo):
    (found,) = yolo({"000000.txt": f"2 {AT_BORDER}"}).detections
    assert found.track_id is None
    assert found.bbox == pytest.approx((124, 338, 124, 37), abs=1)


def test_other_lines_tell_a_track_from_a_point_at_the_border(yolo):
    found = yolo({"000000.txt": f"2 {AT_BORDER} 0.5 1\n2 {POLYGON} 0.9 2"})
    assert [d.track_id for d in found.detections] == [1, 2]
    assert [d.score for d in found.detections] == [0.5, 0.9]


def test_confidences_of_1_are_no_tracks_where_two_lines_of_a_frame_have_them(yolo):
    assert [t for *_, t in rows_of(yolo({"000000.txt": f"2 {POLYGON} 1\n2 {AT_BORDER} 1"}))] == [None, None]


@pytest.mark.parametrize("end", ["", " 0.9", " 0.9 1", " 0.9 2", " 7"])
def test_boxes_are_no_masks(yolo, end):
    with pytest.raises(DetectionError, match=r"000000\.txt:1: a box, no masks"):
        yolo({"000000.txt": f"2 0.52 0.52 0.08 0.08{end}"})


# ---- frames


FROM_ONE = {f"clip_{n}.txt": f"2 {POLYGON} 0.9" for n in (1, 2, 3)}


def test_frames_that_count_from_1_are_said_and_an_option_reads_them(yolo):
    plain = yolo(FROM_ONE)
    assert [d.frame for d in plain.detections] == [1, 2, 3]
    assert "frame 0 has no detection, but frames 1 to 3 all have" in plain.warnings[-1]
    assert "--first-frame 1" in plain.warnings[-1]
    shifted = yolo(FROM_ONE, ImageFrames((0, 1, 2, 3), 1242, 375, first=1))
    assert [d.frame for d in shifted.detections] == [0, 1, 2]
    assert not any("--first-frame" in note for note in shifted.warnings)


def test_a_gap_or_a_first_frame_with_detections_is_no_sign_of_counting_from_1(yolo):
    assert len(yolo({"0.txt": f"2 {POLYGON}", "1.txt": f"2 {POLYGON}"}).warnings) == 1
    (yolo_gap := ImageFrames((0, 1, 2, 3, 4), 1242, 375))
    assert all("--first" not in note for note in yolo({"2.txt": f"2 {POLYGON}", "4.txt": ""}, yolo_gap).warnings)


def test_a_number_one_past_the_last_frame_names_the_option(yolo):
    with pytest.raises(DetectionError, match=r"frame 4: the recording's frames are 0 to 3 \(if .*: --first-frame 1\)"):
        yolo({"4.txt": f"2 {POLYGON}"})
    with pytest.raises(DetectionError, match=r"frames are 0 to 3, counted here from 1$"):
        yolo({"4.txt": "", "5.txt": f"2 {POLYGON}"}, ImageFrames((0, 1, 2, 3), 1242, 375, first=1))


def test_mots_ids_below_zero_are_no_tracks_and_the_set_can_be_read_again(tmp_path):
    frames = ImageFrames((5, 6), 28, 28, first=1)
    path = tmp_path / "mots.txt"
    path.write_text(f"1 -1 1 28 28 {COUNTS}\n2 1004 1 28 28 {COUNTS} \n\n")
    found = from_mots_txt(path, frames)
    assert [d.track_id for d in found.detections] == [None, 1004]
    (tmp_path / "d.json").write_bytes(write_detections(found))
    assert [(d.frame, d.track_id) for d in read_detections(tmp_path / "d.json").detections] == [(5, None), (6, 1004)]


@pytest.mark.parametrize("line", ["1.5 1 1", "1 1e300 1", "1 1 1e300", "1 nan 1", "9" * 400 + " 1 1", "x 1 1"])
def test_mots_numbers_that_are_no_integers_are_named(tmp_path, line):
    (tmp_path / "mots.txt").write_text(f"{line} 28 28 {COUNTS}")
    with pytest.raises(DetectionError, match=r"mots\.txt:1: .*") as caught:
        from_mots_txt(tmp_path / "mots.txt", ImageFrames((0, 1), 28, 28))
    assert len(str(caught.value).removeprefix(str(tmp_path))) < 200


# ---- class names


def test_class_numbers_are_named_by_coco_unless_names_are_given(yolo):
    text = {"000000.txt": f"0 {POLYGON} 0.9"}
    plain, named = yolo(text), yolo(text, names={0: "car"})
    assert [d.category for d in (*plain.detections, *named.detections)] == ["person", "car"]
    assert "COCO's names (--names gives others): 0 = person (1)" in plain.warnings[0]
    assert "the names given: 0 = car (1)" in named.warnings[0]
    with pytest.raises(DetectionError, match=r"class 1: expected one of 0 "):
        yolo({"000000.txt": f"1 {POLYGON} 0.9"}, names=["car"])


@pytest.mark.parametrize("ids", [(1, 2), (0, 1)])
def test_results_count_classes_from_1_unless_one_is_0(tmp_path, ids):
    row = {"image_id": 0, "score": 0.5, "segmentation": {"size": [28, 28], "counts": COUNTS}}
    path = tmp_path / "results.json"
    path.write_text(json.dumps([row | {"category_id": i} for i in ids]))
    names = counted_from_one(path, {0: "car", 1: "bus"})
    found = from_coco_results(path, ImageFrames((0,), 28, 28), names)
    assert [d.category for d in found.detections] == ["car", "bus"]
    assert counted_from_one(path, {1: "car"}) == {1: "car"}


NAMES = {
    "data.yaml": ("path: x\nnc: 2\nnames:\n  0: car\n  1: bus\n", {0: "car", 1: "bus"}),
    "list.yaml": ("names: [car, bus]\n", {0: "car", 1: "bus"}),
    "classes.txt": ("\ufeffcar\nbus\n\n", {0: "car", 1: "bus"}),
}


@pytest.mark.parametrize("name", NAMES)
def test_class_names_are_read_from_a_file(tmp_path, name):
    text, expected = NAMES[name]
    (tmp_path / name).write_text(text, encoding="utf-8")
    assert read_class_names(str(tmp_path / name)) == expected


def test_class_names_are_read_from_a_list():
    assert read_class_names("car, traffic light,") == {0: "car", 1: "traffic light"}
    assert read_class_names("0=car,7=truck") == {0: "car", 7: "truck"}


@pytest.mark.parametrize("given", ["", "a=car", "0=", "-1=car"])
def test_class_names_that_are_none_are_refused(given):
    with pytest.raises(DetectionError, match="--names"):
        read_class_names(given)


@pytest.mark.parametrize("text", ["names: 3", "nc: 3", "names: {a: car}", "names: [1]", "names: [", "\x00"])
def test_files_without_class_names_are_refused(tmp_path, text):
    path = tmp_path / "data.yaml"
    path.write_text(text)
    with pytest.raises(DetectionError, match=r"data\.yaml: "):
        read_class_names(str(path))
