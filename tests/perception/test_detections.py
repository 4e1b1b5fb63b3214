"""The contract of detections.json: what goes in comes out, and what is wrong is named."""

import copy
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from pycocotools import mask as coco

from meshslam.errors import DetectionError
from meshslam.perception import (
    CategoryEntry,
    Detection,
    DetectionSet,
    ImageEntry,
    read_detections,
    write_detections,
)
from meshslam.perception.masks import decode_segmentation, encode_mask, segmentation_problem, unpack_counts

HEIGHT, WIDTH = 40, 60
MASKS = arrays.arrays(np.uint8, st.tuples(st.integers(1, 40), st.integers(1, 40)), elements=st.integers(0, 1))


def example():
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[10:20, 5:30] = 1
    plain = {"size": [HEIGHT, WIDTH], "counts": [0, HEIGHT * WIDTH]}
    polygons = [[1, 1, 20.5, 1, 20.5, 12], [30, 30, 40, 30, 40, 39, 30, 39]]
    common = {"image_id": 3, "category_id": 7, "bbox": [5, 10, 25.0, 10]}
    points = [6, 11, 2, 7, 12, 1, -5, -5, 0]
    rows = [
        common | {"id": 1, "segmentation": encode_mask(mask), "score": 0.5, "track_id": 4, "keypoints": [*points]},
        common | {"id": 2, "segmentation": plain, "keypoints": points, "keypoint_scores": [0.7, 0.0, 0.9]},
        common | {"id": 5, "segmentation": polygons, "image_id": 0},
    ]
    return {
        "images": [{"id": i, "file_name": f"{i:06d}.png", "width": WIDTH, "height": HEIGHT} for i in (0, 1, 3)],
        "categories": [{"id": 7, "name": "car", "keypoints": ["a", "b", "c"]}, {"id": 2, "name": "bus"}],
        "annotations": rows,
    }


def read(tmp_path, root):
    path = tmp_path / "detections.json"
    path.write_text(root if isinstance(root, str) else json.dumps(root))
    return read_detections(path)


def test_what_is_read_is_written_back(tmp_path):
    root = example()
    found = read(tmp_path, root)
    written = json.loads(write_detections(found))
    assert written["images"] == root["images"]
    assert written["categories"] == root["categories"]
    for before, after in zip(root["annotations"], written["annotations"], strict=True):
        assert after["segmentation"] == before["segmentation"]
        assert {k: after[k] for k in ("id", "image_id", "category_id", "bbox")} == {
            k: before[k] for k in ("id", "image_id", "category_id", "bbox")
        }
        assert after.get("track_id") == before.get("track_id")
    again = read(tmp_path, write_detections(found).decode())
    assert write_detections(again) == write_detections(found)


def test_what_a_network_says_of_key_points_is_written_as_it_was_read(tmp_path):
    root = example()
    said = {"keypoint_sigmas_px": [1.234, 2.5, 0.75], "viewing_angle_shares": [0.1003, 0.3333, 0.3333, 0.2333]}
    root["annotations"][1] |= said
    written = json.loads(write_detections(read(tmp_path, root)))["annotations"]
    assert {key: written[1][key] for key in said} == said
    assert not said.keys() & written[0].keys()


def test_defaults_groups_and_tracks(tmp_path):
    found = read(tmp_path, example())
    assert [d.score for d in found.detections] == [0.5, 1.0, 1.0]
    assert {f: [d.id for d in ds] for f, ds in found.by_frame().items()} == {0: [5], 1: [], 3: [1, 2]}
    assert found.keypoint_names("car") == ("a", "b", "c")
    assert found.keypoint_names("bus") == found.keypoint_names("tree") == ()
    moved = found.with_tracks({1: None, 5: 9, 2: 9})
    assert [d.track_id for d in moved.detections] == [None, 9, 9]
    assert {t: [d.id for d in ds] for t, ds in moved.by_track().items()} == {9: [5, 2]}
    assert found.detections[0].track_id == 4


def test_a_key_point_with_v_zero_carries_no_information(tmp_path):
    first, second, third = read(tmp_path, example()).detections
    assert first.keypoint_scores.tolist() == [0.95, 0.5, 0.0]  # from v
    assert second.keypoint_scores.tolist() == [0.7, 0.0, 0.0]  # v = 0 wins over its score
    assert third.keypoints is None
    root = example()
    root["annotations"][0]["keypoints"][6:8] = [float("nan"), None]
    assert np.isfinite(read(tmp_path, root).detections[0].keypoints).all()


@pytest.mark.parametrize("outside", [(-0.6, 5), (WIDTH - 0.4, 5), (5, HEIGHT + 3)])
def test_key_points_outside_the_image_are_handled_and_said(tmp_path, outside):
    root = example()
    assert read(tmp_path, root).warnings == ()
    root["annotations"][0]["keypoints"][:2] = outside
    found = read(tmp_path, root)
    assert found.detections[0].keypoint_scores.tolist() == [0.0, 0.5, 0.0]
    assert "information: 1 (first: annotation 1)" in found.warnings[0]


def test_the_names_of_apollo_are_ours(tmp_path):
    root = example()
    root["categories"][0]["keypoints"] = ["front_light_left", "rear_plate_left", "left_back_wheel"]
    assert read(tmp_path, root).keypoint_names("car") == ("left_front_light", "rear_plate_left", "left_back_wheel")


def test_confidences_above_one_are_handled_and_said(tmp_path):
    root = example()
    root["annotations"][1]["keypoint_scores"][0] = 1.2
    found = read(tmp_path, root)
    assert found.detections[1].keypoint_scores[0] == 1.0
    assert "annotation 2" in found.warnings[0]


NAN = float("nan")
BROKEN = {  # path in the file, value (None: delete), what the message says
    "unknown category": ("annotations.1.category_id", 9, "annotations[1] (id 2): category_id: found 9"),
    "unknown image": ("annotations.1.image_id", 2, "annotations[1] (id 2): image_id: found 2"),
    "size": ("annotations.1.segmentation.size", [WIDTH, HEIGHT], "annotations[1] (id 2): segmentation: has size"),
    "short counts": ("annotations.1.segmentation.counts", [0, 5], "segmentation: has counts that cover 5 pixels"),
    "negative counts": ("annotations.1.segmentation.counts", [-1, HEIGHT * WIDTH + 1], "segmentation: has counts"),
    "packed counts": ("annotations.1.segmentation.counts", "o", "segmentation: has counts that are no packed"),
    "no counts": ("annotations.1.segmentation.counts", None, "segmentation: has counts of type NoneType"),
    "mask kind": ("annotations.1.segmentation", "mask.png", "segmentation: is str"),
    "no polygons": ("annotations.2.segmentation", [], "annotations[2] (id 5): segmentation: is an empty list"),
    "two points": ("annotations.2.segmentation", [[1, 2, 3, 4]], "segmentation: has a polygon 0"),
    "odd polygon": ("annotations.2.segmentation", [[1, 2, 3, 4, 5, 6, 7]], "segmentation: has a polygon 0"),
    "NaN polygon": ("annotations.2.segmentation", [[1, 2, 3, 4, 5, NAN]], "segmentation: has a polygon 0"),
    "far polygon": ("annotations.2.segmentation", [[1, 2, 3, 4, 1e9, 6]], "far outside"),
    "no mask": ("annotations.1.segmentation", None, "annotations[1] (id 2): segmentation: is missing"),
    "short bbox": ("annotations.1.bbox", [1, 2, 3], "bbox: found [1, 2, 3]"),
    "negative bbox": ("annotations.1.bbox", [1, 2, 3, -4], "bbox: found [1, 2, 3, -4]"),
    "NaN bbox": ("annotations.1.bbox", [1, 2, 3, NAN], "bbox: found NaN"),
    "huge bbox": ("annotations.1.bbox", [1, 2, 3, 10**400], "bbox: found 1000"),
    "NaN score": ("annotations.0.score", NAN, "annotations[0] (id 1): score: found NaN"),
    "negative score": ("annotations.0.score", -0.1, "score: found -0.1"),
    "no id": ("annotations.0.id", None, "annotations[0]: id: is missing"),
    "text id": ("annotations.0.id", "one", 'id: found "one"'),
    "same id": ("annotations.1.id", 1, "annotations[1] (id 1): id: 1 is used twice"),
    "same image": ("images.1.id", 0, "images[1] (id 0): id: 0 is used twice"),
    "same name": ("categories.1.name", "car", "categories: names must differ"),
    "no name": ("categories.1.name", None, "categories[1] (id 2): name: is missing"),
    "no width": ("images.0.width", None, "images[0] (id 0): width: is missing"),
    "no height": ("images.0.height", 0, "images[0] (id 0): width, height"),
    "key point count": ("annotations.0.keypoints", [1, 2, 2], "annotations[0] (id 1): keypoints: found 3 numbers"),
    "key points unnamed": ("categories.0.keypoints", None, "keypoints: found 9 numbers"),
    "NaN key point": ("annotations.0.keypoints.0", NAN, "annotations[0] (id 1): keypoints: found NaN"),
    "visibility": ("annotations.0.keypoints.2", 3, "keypoints: found v = 3"),
    "visibility kind": ("annotations.0.keypoints.2", [], "keypoints: found v = []"),
    "scores": ("annotations.1.keypoint_scores", [1], "keypoint_scores: found 1 numbers, expected 3"),
    "NaN scores": ("annotations.1.keypoint_scores.0", NAN, "keypoint_scores: found NaN"),
    "sigmas": ("annotations.1.keypoint_sigmas_px", [1, 2], "keypoint_sigmas_px: expected 3 numbers"),
    "NaN sigmas": ("annotations.1.keypoint_sigmas_px", [1, NAN, 1], "keypoint_sigmas_px: found NaN"),
    "zero sigmas": ("annotations.1.keypoint_sigmas_px", [1, 0, 1], "keypoint_sigmas_px: found 0"),
    "few shares": ("annotations.1.viewing_angle_shares", [1, 2], "viewing_angle_shares: expected a list of at least 4"),
    "negative shares": ("annotations.1.viewing_angle_shares", [1, 2, -1, 1], "viewing_angle_shares: expected shares"),
    "no shares": ("annotations.1.viewing_angle_shares", [0, 0, 0, 0], "viewing_angle_shares: expected shares"),
    "NaN shares": ("annotations.1.viewing_angle_shares", [NAN, 0, 0, 0], "viewing_angle_shares: found NaN"),
    "same names": ("categories.0.keypoints", ["a", "a", "b"], "categories[0] (id 7): keypoints: expected a list"),
    "one point twice": (
        "categories.0.keypoints",
        ["front_light_left", "left_front_light", "b"],
        "categories[0] (id 7): keypoints: expected a list",
    ),
    "names kind": ("categories.0.keypoints", "abc", "categories[0] (id 7): keypoints: expected a list"),
    "track": ("annotations.1.track_id", "a", 'track_id: found "a"'),
    "no annotations": ("annotations", None, "annotations: is missing"),
    "images kind": ("images", {}, "images: found an object, expected a list"),
    "entry kind": ("annotations.1", 3, "annotations[1]: found a number, expected an object"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_wrong_is_named(tmp_path, name):
    place, value, message = BROKEN[name]
    root = copy.deepcopy(example())
    *parents, last = [int(p) if p.isdigit() else p for p in place.split(".")]
    node = root
    for parent in parents:
        node = node[parent]
    if value is None:
        del node[last]
    else:
        node[last] = value
    with pytest.raises(DetectionError) as caught:
        read(tmp_path, root)
    assert message in str(caught.value)
    assert str(tmp_path / "detections.json") in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", '{"images": [}', "[" * 100_000])
def test_what_is_no_json_object_is_named(tmp_path, text):
    with pytest.raises(DetectionError, match=r"detections\.json: (is no JSON|found)"):
        read(tmp_path, text)


def test_a_file_that_is_missing_or_binary_is_named(tmp_path):
    with pytest.raises(DetectionError, match="cannot be read"):
        read_detections(tmp_path / "nothing.json")
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DetectionError, match="is no JSON"):
        read_detections(tmp_path / "binary.json")


@settings(max_examples=100, deadline=None)
@given(MASKS)
def test_masks_survive_every_way_of_writing(mask):
    height, width = mask.shape
    packed = encode_mask(mask)
    runs = unpack_counts(packed["counts"])
    plain = {"size": [height, width], "counts": runs.tolist()}
    for code in (packed, plain):
        assert segmentation_problem(code, height, width) is None
        np.testing.assert_array_equal(decode_segmentation(code, height, width), mask)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(0, 2000), min_size=1, max_size=30))
def test_counts_unpack_to_the_runs_that_were_packed(runs):
    code = coco.frPyObjects({"size": [1, sum(runs)], "counts": runs}, 1, sum(runs))
    assert unpack_counts(code["counts"].decode()).tolist() == runs


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=40))
def test_damaged_counts_are_found_not_decoded(text):
    code = {"size": [20, 30], "counts": text}
    if segmentation_problem(code, 20, 30) is None:
        assert decode_segmentation(code, 20, 30).shape == (20, 30)


def test_polygons_cover_what_they_enclose():
    square = [[5.0, 5.0, 15.0, 5.0, 15.0, 12.0, 5.0, 12.0], [20, 20, 25, 20, 25, 25, 20, 25]]
    mask = decode_segmentation(square, HEIGHT, WIDTH)
    expected = np.zeros((HEIGHT, WIDTH), np.uint8)
    expected[5:12, 5:15] = 1
    expected[20:25, 20:25] = 1
    np.testing.assert_array_equal(mask, expected)


def test_packed_runs_beyond_the_image_are_named_by_their_range():
    huge = "PPPPPPPP1"  # 2^40
    assert "has counts from" in segmentation_problem({"size": [20, 30], "counts": huge}, 20, 30)


def test_what_all_detections_of_a_file_have_in_common_is_held_once(tmp_path):
    """Memory of a long drive: the size of its images and of its masks, once; the file's own values come back."""
    mask = np.zeros((20, 30), np.uint8)
    mask[5:12, 8:20] = 1
    seen = tuple(Detection.from_mask(mask, id=k + 1, frame=k) for k in range(3))
    images = tuple(ImageEntry(k, f"{k:06d}.png", 30, 20) for k in range(3))
    path = tmp_path / "detections.json"
    path.write_bytes(write_detections(DetectionSet(images, (CategoryEntry(1, "car"),), seen)))
    read = read_detections(path)
    assert len({id(d.image_size) for d in read.detections}) == 1
    assert len({id(d.segmentation["size"]) for d in read.detections}) == 1
    assert write_detections(read) == path.read_bytes()
