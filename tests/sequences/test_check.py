import json

import numpy as np
import pytest
from pycocotools import mask as rle

from meshslam.sequences import ImuSamples, check_sequence, write_sequence_folder
from tests.sequences.conftest import CAMERA, FRAMES, coco_document


@pytest.fixture
def problems(tmp_path):
    """What the check says of a document, without the path."""

    def found(document):
        folder = write_sequence_folder(tmp_path / "s", CAMERA, np.arange(FRAMES) * 0.1, detections=document)
        return [f"{p.where}: {p.what}" for p in check_sequence(folder)]

    return found


def changed(**changes):
    document = coco_document()
    document["annotations"][2] |= changes
    return document


def without(key):
    document = coco_document()
    del document[key]
    return document


def test_a_sound_document_has_no_problems(problems, rng):
    document = coco_document()
    for annotation in document["annotations"]:
        mask = np.asfortranarray((rng.random((48, 64)) < 0.3).astype(np.uint8))
        packed = rle.encode(mask)
        annotation["segmentation"] = {"size": [48, 64], "counts": packed["counts"].decode()}
    document["annotations"][0]["segmentation"] = [[1.0, 2.0, 30.5, 2.0, 30.5, 20.0]]
    document["annotations"][1]["track_id"] = 7
    assert problems(document) == []


def test_masks_without_pixels_and_with_long_runs_are_sound(problems):
    document = coco_document()
    full, empty = np.ones((48, 64), np.uint8, order="F"), np.zeros((48, 64), np.uint8, order="F")
    for annotation, mask in zip(document["annotations"], (full, empty), strict=False):
        annotation["segmentation"] = {"size": [48, 64], "counts": rle.encode(mask)["counts"].decode()}
    assert problems(document) == []


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (without("images"), "images: key is missing"),
        (without("categories"), "categories: key is missing"),
        (without("annotations"), "annotations: key is missing"),
        (coco_document() | {"annotations": {}}, "annotations: expected a list"),
        (coco_document() | {"annotations": [3]}, "annotations[0]: expected an object"),
        ([], ": expected an object"),
        (changed(image_id=99), "annotations id 3: image_id 99 is not in images"),
        (changed(category_id=5), "annotations id 3: category_id 5 is not in categories"),
        (changed(id=1), "annotations[2]: id 1 comes twice"),
        (changed(id="a"), "annotations[2]: id 'a' is no whole number"),
        (changed(bbox=[1.0, float("nan"), 3.0, 4.0]), "annotations id 3: bbox [1.0, nan, 3.0, 4.0] is not four finite"),
        (changed(bbox=[1.0, 2.0, 3.0]), "annotations id 3: bbox [1.0, 2.0, 3.0] is not four finite"),
        (changed(bbox=[1.0, 2.0, 0.0, 4.0]), "annotations id 3: bbox [1.0, 2.0, 0.0, 4.0] has no area"),
        (changed(bbox=None), "annotations id 3: bbox None is not four finite"),
        (changed(keypoints=[1.0, 2.0, 2]), "annotations id 3: keypoints holds 3 numbers, expected 6"),
        (changed(keypoints=[1.0, 2.0, 2, float("inf"), 0, 2]), "annotations id 3: keypoints are not finite"),
        (changed(keypoint_scores=[0.1]), "annotations id 3: keypoint_scores holds 1 numbers, expected 2"),
        (
            changed(keypoint_scores=[0.1, -0.1]),
            "annotations id 3: keypoint_scores holds -0.1, expected numbers 0 or more",
        ),
        (changed(keypoints=[1.0, 2.0, 3, 0, 0, 0]), "annotations id 3: keypoints: v of each x, y, v is 0, 1 or 2"),
        (changed(keypoint_sigmas_px=[1.0]), "annotations id 3: keypoint_sigmas_px holds 1 numbers, expected 2"),
        (
            changed(keypoint_sigmas_px=[1.0, 0]),
            "annotations id 3: keypoint_sigmas_px holds 0, expected numbers above 0",
        ),
        (changed(keypoint_sigmas_px=[1.0, "a"]), "annotations id 3: keypoint_sigmas_px are not finite"),
        (changed(viewing_angle_shares=[1, 1, 1]), "annotations id 3: viewing_angle_shares: expected 4 or more"),
        (changed(viewing_angle_shares=[1, 1, 1, -1]), "annotations id 3: viewing_angle_shares: expected 4 or more"),
        (changed(viewing_angle_shares=[0, 0, 0, 0]), "annotations id 3: viewing_angle_shares: expected 4 or more"),
        (changed(viewing_angle_shares="north"), "annotations id 3: viewing_angle_shares: expected 4 or more"),
        (changed(segmentation=None), "annotations id 3: segmentation is missing"),
        (changed(score=float("nan")), "annotations id 3: score nan is no number"),
        (changed(score="high"), "annotations id 3: score 'high' is no number"),
        (changed(track_id="x"), "annotations id 3: track_id 'x' is no whole number"),
        (
            changed(segmentation={"size": [64, 48], "counts": [3072]}),
            "segmentation: RLE of size [64, 48]",
        ),
        (
            changed(segmentation={"size": [48, 64], "counts": [3]}),
            "segmentation: RLE counts do not add up",
        ),
        (
            changed(segmentation={"size": [48, 64], "counts": "d0"}),
            "segmentation: RLE counts do not add up",
        ),
        (
            changed(segmentation={"size": [48, 64], "counts": "\u00e9"}),
            "segmentation: RLE counts do not",
        ),
        (changed(segmentation={"size": [48, 64]}), "segmentation is neither"),
        (changed(segmentation=[[1.0, 2.0, 3.0]]), "segmentation: a polygon is"),
        (changed(segmentation=[]), "segmentation: a polygon is"),
    ],
)
def test_each_problem_of_a_document_is_named(problems, document, message):
    (line,) = problems(document)
    assert message in line


def test_images_of_other_frames_or_sizes_are_named(problems):
    document = coco_document()
    document["images"][1]["width"] = 65
    document["images"][4]["id"] = 9
    document["annotations"][4]["image_id"] = 9
    assert problems(document) == [
        "images id 1: is 65x48, the camera's is 64x48",
        "images id 9: no frame of that number; frames are 0 to 4",
    ]


def test_no_json_is_named_by_its_line(folder):
    (folder / "detections.json").write_text('{\n"images": [,]}')
    assert [p.where for p in check_sequence(folder)] == ["line 2"]


def test_all_problems_of_all_files_are_listed(folder):
    (folder / "camera.yaml").write_text("model: fisheye\nresolution: [64, 48]\n")
    (folder / "times.txt").write_text("0\nnan\n0.3\n0.2\n0.4\n")
    (folder / "poses.tum").write_text("".join(f"{0.1 * i} 0 0 0 0 0 0 {1 + (i == 1)}\n" for i in range(5)))
    (folder / "imu.csv").write_text("timestamp,wx,wy,wz,ax,ay,az\n0,0,0,0,0,0\n")
    (folder / "images" / "000002.png").write_bytes(b"")
    document = coco_document()
    document["annotations"][0]["bbox"] = []
    document["annotations"][1]["category_id"] = 4
    (folder / "detections.json").write_text(json.dumps(document))
    found = [(p.file.name, p.where) for p in check_sequence(folder)]
    assert sorted(found) == [
        ("000002.png", ""),
        ("camera.yaml", "intrinsics"),
        ("camera.yaml", "model"),
        ("detections.json", "annotations id 1"),
        ("detections.json", "annotations id 2"),
        ("imu.csv", ""),
        ("imu.csv", "line 2"),
        ("poses.tum", "line 2"),
        ("times.txt", "line 2"),
        ("times.txt", "line 4"),
    ]


def imu_folder(tmp_path, times_s, poses=None):
    count = len(times_s)
    return write_sequence_folder(
        tmp_path / "s",
        CAMERA,
        np.arange(FRAMES) * 0.1,
        detections=coco_document(),
        imu=ImuSamples(times_s, np.zeros((count, 3)), np.zeros((count, 3))),
        imu_from_camera=poses,
    )


@pytest.mark.parametrize(
    ("times_s", "where", "what"),
    [
        (np.arange(-1, 6) * 0.1, "rate", "10.0 Hz, at least 50 Hz"),
        (np.arange(0, 20) * 0.01, "overlap", "do not cover the frames from 0.000 s to 0.400 s"),
        (np.r_[np.arange(0, 10) * 0.01, np.arange(20, 50) * 0.01], "rate", "no samples between 0.090 s and 0.200 s"),
    ],
)
def test_imu_rate_overlap_and_gaps_are_looked_at(tmp_path, times_s, where, what):
    from meshslam.geometry import Pose

    found = check_sequence(imu_folder(tmp_path, times_s, Pose.identity()))
    assert [p.where for p in found] == [where]
    assert what in found[0].what


def test_an_unknown_key_is_noted(folder):
    with (folder / "camera.yaml").open("a") as file:
        file.write("distortion_coefs: [1, 2, 3, 4]\n")
    assert [(p.where, p.severity) for p in check_sequence(folder)] == [("distortion_coefs", "note")]
