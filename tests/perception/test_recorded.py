"""Detections that come with a recording: what cannot be meant is put right and said, never used in silence."""

import json
from pathlib import Path

import numpy as np
import pytest

from meshslam.errors import ConfigError, DetectionError
from meshslam.geometry import Camera
from meshslam.perception import encode_mask, read_recorded_detections, renamings, untracked
from meshslam.sequences import ImageFiles, Sequence

WIDTH, HEIGHT, COUNT = 64, 48, 4
CAMERA = Camera(WIDTH, HEIGHT, 60.0, 60.0, 31.5, 23.5)


def recording(names=None, frames=range(COUNT)):
    """A sequence of some frames, with images of these names or without images."""
    paths = None if names is None else tuple(Path("images", name) for name in names)
    numbers = tuple(frames)
    return Sequence(
        "s",
        "folder",
        Path("s"),
        CAMERA,
        numbers,
        np.arange(len(numbers)) * 0.1,
        images=None if paths is None else ImageFiles(paths),
    )


def mask(x, y, w=12, h=10):
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    pixels[y : y + h, x : x + w] = 1
    return encode_mask(pixels)


def row(id_, image, x=4, y=5, category=1, **more):
    box = {"bbox": [x, y, 12, 10]}
    return {"id": id_, "image_id": image, "category_id": category, "segmentation": mask(x, y)} | box | more


def document(rows, images=range(COUNT), names=None, categories=("car",)):
    names = [f"{i:06d}.png" for i in images] if names is None else names
    return {
        "images": [
            {"id": i, "file_name": name, "width": WIDTH, "height": HEIGHT}
            for i, name in zip(images, names, strict=True)
        ],
        "categories": [{"id": i + 1, "name": name} for i, name in enumerate(categories)],
        "annotations": rows,
    }


@pytest.fixture
def read(tmp_path):
    def found(content, sequence=None, **options):
        path = tmp_path / "detections.json"
        path.write_text(json.dumps(content))
        return read_recorded_detections(path, sequence or recording(), **options)

    return found


def frames_of(found):
    return {d.id: d.frame for d in found.detections}


# ---- images and frames

FROM_ONE = [row(i, i) for i in (1, 2, 3)]
BY_FILE = {
    "basename": (["000000.png", "000001.png", "000002.png"], [f"{i:06d}.png" for i in range(4)]),
    "stem": (["train/000000.jpg", "train/000001.jpg", "train/000002.jpg"], [f"{i:06d}.png" for i in range(4)]),
    "windows": ([r"c:\a\a.png", r"c:\a\b.png", r"c:\a\c.png"], ["a.png", "b.png", "c.png", "d.png"]),
    "number": (["000000.png", "000001.png", "000002.png"], [f"{i:010d}.png" for i in range(4)]),
    "no images": (["frame_0.png", "frame_1.png", "frame_2.png"], None),
}


@pytest.mark.parametrize("kind", BY_FILE)
def test_file_names_outrank_ids_and_that_is_said(read, kind):
    names, files = BY_FILE[kind]
    found = read(document(FROM_ONE, (1, 2, 3), names), recording(files))
    assert frames_of(found) == {1: 0, 2: 1, 3: 2}
    assert [i.id for i in found.images] == [0, 1, 2, 3]
    assert "file_name, which outranks ids: 3 of 3" in found.warnings[0]


@pytest.mark.parametrize("kind", BY_FILE)
def test_a_part_of_the_frames_has_its_own_detections_of_a_file_of_all(read, kind):
    names, files = BY_FILE[kind]
    found = read(document(FROM_ONE, (1, 2, 3), names), recording(files).part([1, 3]))
    assert frames_of(found) == {2: 1}
    assert [i.id for i in found.images] == [1, 3]


@pytest.mark.parametrize(
    "names", [["a.png", "b.png", "c.png"], ["9.png", "1.png", "2.png"], ["1.png", "x.png", "2.png"]]
)
def test_ids_are_frames_where_names_say_nothing(read, names):
    found = read(document(FROM_ONE, (1, 2, 3), names))
    assert frames_of(found) == {1: 1, 2: 2, 3: 3}
    assert found.warnings == ()


def test_names_that_agree_with_ids_are_not_worth_a_word(read):
    assert read(document(FROM_ONE), recording([f"{i:06d}.png" for i in range(4)])).warnings == ()


def test_images_that_cannot_be_matched_are_refused(read):
    files = [f"{i:06d}.png" for i in range(4)]
    with pytest.raises(DetectionError, match=r'images id 2: file_name "b.png" is no image of the recording'):
        read(document(FROM_ONE, (1, 2, 3), ["000000.png", "b.png", "000002.png"]), recording(files))
    with pytest.raises(DetectionError, match=r"two entries are frame 0"):
        read(document(FROM_ONE, (1, 2, 3), ["a/000000.png", "b/000000.png", "000002.png"]), recording(files))
    with pytest.raises(DetectionError, match=r"images id 4: no frame of that number; frames are 0 to 3"):
        read(document([], (1, 2, 3, 4), ["a", "b", "c", "d"]))


# ---- crowd regions


def test_a_crowd_region_over_other_annotations_is_left_out(read):
    crowd = {"segmentation": mask(2, 2, 50, 30), "bbox": [2, 2, 50, 30], "iscrowd": 1}
    apart = row(4, 0, 4, 36, iscrowd=1)
    found = read(document([row(1, 0), row(2, 0, 30), row(3, 0) | crowd, apart]))
    assert [d.id for d in found.detections] == [1, 2, 4]
    assert "iscrowd 1 that cover other annotations are left out: 1 (first: annotation 3)" in found.warnings[0]
    assert "read as objects: 1 (first: annotation 4)" in found.warnings[1]


def test_a_file_of_crowds_alone_is_read(read):
    found = read(document([row(1, 0, iscrowd=1), row(2, 0, 6, iscrowd=1)]))
    assert [d.id for d in found.detections] == [1, 2]
    assert "all 2 annotations have iscrowd 1" in found.warnings[0]


def test_a_crowd_of_polygons_and_plain_counts_is_measured_too(read):
    polygon = {"segmentation": [[0, 0, 60, 0, 60, 40, 0, 40]], "bbox": [0, 0, 60, 40], "iscrowd": 1}
    plain = row(1, 0) | {"segmentation": {"size": [48, 64], "counts": [48 * 4 + 5, 10, 48 * 60 - 15]}}
    plain["bbox"] = [4, 5, 1, 10]
    assert [d.id for d in read(document([plain, row(2, 0) | polygon])).detections] == [1]


# ---- boxes

KINDS = {
    "corners": lambda x, y, w, h: [x, y, x + w, y + h],
    "centre": lambda x, y, w, h: [x + w / 2, y + h / 2, w, h],
    "shares": lambda x, y, w, h: [x / WIDTH, y / HEIGHT, w / WIDTH, h / HEIGHT],
    "nowhere": lambda *_: [1e9, 1e9, 1e9, 1e9],
}


@pytest.mark.parametrize("kind", KINDS)
def test_boxes_of_another_kind_are_replaced_by_the_masks(read, kind):
    rows = [row(i + 1, i, 20 + i, 15) for i in range(4)]
    for entry in rows:
        entry["bbox"] = KINDS[kind](*entry["bbox"])
    found = read(document(rows))
    assert [d.bbox for d in found.detections] == [(20.0 + i, 15.0, 12.0, 10.0) for i in range(4)]
    assert "in 4 of 4 annotations (first: annotation 1): all boxes are taken from the masks" in found.warnings[0]


def test_one_wrong_box_leaves_the_others_as_they_are(read):
    found = read(document([row(1, 0, bbox=[40, 30, 5, 5]), row(2, 1, bbox=[3, 4, 14, 12]), row(3, 2)]))
    assert [d.bbox for d in found.detections] == [(4, 5, 12, 10), (3, 4, 14, 12), (4, 5, 12, 10)]
    assert "in 1 of 3 annotations" in found.warnings[0]


def test_a_missing_box_is_the_masks(read):
    entry = row(1, 0)
    del entry["bbox"]
    empty = row(2, 0) | {"segmentation": {"size": [48, 64], "counts": [48 * 64]}, "bbox": None}
    found = read(document([entry, empty, row(3, 1) | {"segmentation": [[4, 5, 16, 5, 16, 15, 4, 15]], "bbox": None}]))
    assert [d.bbox for d in found.detections] == [(4, 5, 12, 10), (0, 0, 0, 0), (4, 5, 12, 10)]
    assert found.warnings == ()


# ---- tracks


def tracks(found):
    return [d.track_id for d in found.detections]


def test_ids_that_are_counted_for_each_class_are_tracks_of_a_class(read):
    rows = [row(1, 0, 4, category=2, track_id=1), row(2, 0, 30, track_id=1), row(3, 1, 30, track_id=1)]
    found = read(document([*rows, row(4, 1, 4, category=2, track_id=1)], categories=("car", "truck")))
    one, two, three, four = tracks(found)
    assert one == four
    assert two == three
    assert one != two
    assert "counted for each class" in found.warnings[0]


def test_vehicles_keep_their_ids_beside_persons(read):
    rows = [row(1, 0, 4, category=2, track_id=7), row(2, 1, 30, track_id=7)]
    found = read(document(rows, categories=("car", "person")))
    assert tracks(found) == [8, 7]


def test_a_network_that_flips_between_vehicles_has_one_track(read):
    rows = [row(i + 1, i, 4 + i, category=1 + i % 2, track_id=3) for i in range(4)]
    found = read(document(rows, categories=("car", "truck")))
    assert tracks(found) == [3, 3, 3, 3]
    assert found.warnings == ()


def test_an_id_twice_in_a_frame_is_not_used_there(read):
    rows = [row(1, 0, 4, track_id=2), row(2, 0, 30, track_id=2), row(3, 1, 4, track_id=2), row(4, 1, 30, track_id=-1)]
    found = read(document(rows))
    assert tracks(found) == [None, None, 2, None]
    assert "in 1 cases (first: track 2 in frame 0)" in found.warnings[0]


# ---- class names


@pytest.mark.parametrize(("name", "said"), [("Car", 'is read as "car"'), ("Vehicle", "is taken for car")])
def test_names_are_compared_without_regard_to_case_and_usual_ones_guessed(read, name, said):
    found = read(document([row(1, 0)], categories=(name,)))
    assert [d.category for d in found.detections] == ["car"]
    assert said in found.warnings[0]
    assert len(found.warnings) == 1


def test_a_guess_is_not_made_where_the_file_or_its_user_means_another(read):
    beside = read(document([row(1, 0)], categories=("vehicle", "car")))
    tracked = read(document([row(1, 0)], categories=("vehicle",)), tracked=("vehicle",))
    renamed = read(document([row(1, 0)], categories=("vehicle",)), renamed=renamings(["vehicle=bus"]))
    assert [found.detections[0].category for found in (beside, tracked, renamed)] == ["vehicle", "vehicle", "bus"]


def test_classes_that_become_one_are_joined(read):
    rows = [row(1, 0), row(2, 0, 30, category=2)]
    found = read(document(rows, categories=("car", "van")), renamed=renamings(["Van=car"]))
    assert [c.name for c in found.categories] == ["car"]
    assert [d.category for d in found.detections] == ["car", "car"]
    with pytest.raises(DetectionError, match="names must differ"):
        read(document(rows, categories=("car", "CAR")))


@pytest.mark.parametrize("entry", ["vehicle", "=car", "vehicle="])
def test_a_renaming_that_says_nothing_is_refused(entry):
    with pytest.raises(ConfigError, match=r"input\.category_names: found"):
        renamings([entry])


def test_detections_of_no_tracked_class_are_said_in_one_line(read):
    found = read(document([row(1, 0), row(2, 1)], categories=("forklift",)))
    said = untracked(found, ("car", "bus"))
    assert 'tracking.categories: bus, car): found "forklift" (2); input.category_names: [forklift=car]' in said
    assert untracked(found, ("forklift",)) is None
    assert untracked(read(document([])), ("car",)) is None
