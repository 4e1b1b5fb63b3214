"""Detections of other tools come out as the masks that went in."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from meshslam.errors import DetectionError
from meshslam.perception import encode_mask, read_detections, write_detections
from meshslam.perception.conversion.coco_results import from_coco_results
from meshslam.perception.conversion.frames import ImageFrames
from meshslam.perception.conversion.mots import from_mots_png, from_mots_txt
from meshslam.perception.conversion.openpifpaf import with_openpifpaf
from meshslam.perception.conversion.yolo_txt import from_yolo_txt
from meshslam.perception.keypoint_names import APOLLO_24, APOLLO_FROM_OURS

FRAMES = ImageFrames((0, 1, 2), 64, 48)


def square(x, y, side=12):
    mask = np.zeros((48, 64), np.uint8)
    mask[y : y + side, x : x + side] = 1
    return mask


def test_coco_results_keep_frame_class_score_and_mask(tmp_path):
    mask = square(5, 7)
    row = {"image_id": 2, "category_id": 3, "segmentation": encode_mask(mask), "score": 0.7}
    path = tmp_path / "results.json"
    path.write_text(json.dumps([row, {**row, "image_id": 0, "category_id": 90}]))
    found = from_coco_results(path, FRAMES).detections
    assert [(d.frame, d.category, d.score) for d in found] == [(0, "toothbrush", 0.7), (2, "car", 0.7)]
    assert (found[1].mask() == mask).all()
    assert found[1].bbox == (5, 7, 12, 12)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"image_id": 9}, "frame 9"),
        ({"category_id": 12}, "category_id"),
        ({"score": 2}, "score"),
        ({"segmentation": None}, "segmentation"),
    ],
)
def test_coco_results_that_are_wrong_are_named(tmp_path, change, said):
    row = {"image_id": 2, "category_id": 3, "segmentation": encode_mask(square(5, 7)), "score": 0.7} | change
    path = tmp_path / "results.json"
    path.write_text(json.dumps([row]))
    with pytest.raises(DetectionError, match=said):
        from_coco_results(path, FRAMES)


def test_yolo_polygons_are_shares_of_the_image(tmp_path):
    corners = np.array([[10, 6], [30, 6], [30, 20], [10, 20]]) / [64, 48]
    words = " ".join(f"{v:.6f}" for v in corners.ravel())
    (tmp_path / "drive_000001.txt").write_text(f"2 {words} 0.83\n0 {words}\n")
    found = from_yolo_txt(tmp_path, FRAMES).detections
    assert [(d.frame, d.category, d.score) for d in found] == [(1, "car", 0.83), (1, "person", 1.0)]
    expected = np.zeros((48, 64), np.uint8)
    expected[6:20, 10:30] = 1
    assert (found[0].mask() != expected).mean() < 0.02


@pytest.mark.parametrize(
    "line", ["2 0.1 0.2", "99 0.1 0.1 0.2 0.1 0.2 0.2", "2 0.1 x 0.2 0.1 0.2 0.2", "2 9 9 9 8 8 8"]
)
def test_yolo_lines_that_are_wrong_are_named_with_their_place(tmp_path, line):
    (tmp_path / "000001.txt").write_text(line)
    with pytest.raises(DetectionError, match=r"000001.txt:1"):
        from_yolo_txt(tmp_path, FRAMES)


@pytest.mark.parametrize(("given", "track"), [(7, 7), (-1, None), (None, None)])
def test_coco_results_keep_tracks_as_tao_has_them(tmp_path, given, track):
    row = {"image_id": 2, "category_id": 3, "segmentation": encode_mask(square(5, 7)), "score": 0.7, "track_id": given}
    (tmp_path / "results.json").write_text(json.dumps([row]))
    assert from_coco_results(tmp_path / "results.json", FRAMES).detections[0].track_id == track
    (tmp_path / "results.json").write_text(json.dumps([row | {"track_id": "7"}]))
    with pytest.raises(DetectionError, match=r'track_id: found "7", expected an integer'):
        from_coco_results(tmp_path / "results.json", FRAMES)


def test_openpifpaf_keeps_the_tracks_of_the_masks(tmp_path):
    row = {"image_id": 1, "category_id": 3, "segmentation": encode_mask(square(4, 10, 20)), "score": 0.9, "track_id": 5}
    (tmp_path / "results.json").write_text(json.dumps([row]))
    points = np.column_stack([4 + np.arange(24) % 5 * 4, 10 + np.arange(24) // 5 * 4, np.ones(24)])
    (tmp_path / "points").mkdir()
    (tmp_path / "points" / "1.predictions.json").write_text(json.dumps([{"keypoints": points.ravel().tolist()}]))
    (found,) = with_openpifpaf(tmp_path / "points", from_coco_results(tmp_path / "results.json", FRAMES)).detections
    assert found.keypoints is not None
    assert found.track_id == 5


def test_mots_text_and_pictures_say_the_same(tmp_path):
    masks = {1003: square(4, 4), 2007: square(30, 20), 10000: square(50, 2, 8)}
    picture = np.zeros((48, 64), np.uint16)
    lines = []
    for number, mask in masks.items():
        picture[mask > 0] = number
        lines.append(f"1 {number} {number // 1000} 48 64 {encode_mask(mask)['counts']}")
    (tmp_path / "png").mkdir()
    cv2.imwrite(str(tmp_path / "png" / "000001.png"), picture)
    (tmp_path / "mots.txt").write_text("\n".join(lines))
    sets = [from_mots_png(tmp_path / "png", FRAMES), from_mots_txt(tmp_path / "mots.txt", FRAMES)]
    for found in sets:
        assert [(d.frame, d.category, d.track_id) for d in found.detections] == [(1, "car", 1003), (1, "person", 2007)]
        assert (found.detections[0].mask() == masks[1003]).all()


def test_openpifpaf_points_go_to_the_car_whose_box_they_fill(tmp_path):
    rows = [
        {"image_id": 1, "category_id": 3, "segmentation": encode_mask(square(x, 10, 20)), "score": 0.9} for x in (4, 36)
    ]
    (tmp_path / "results.json").write_text(json.dumps(rows))
    plain = from_coco_results(tmp_path / "results.json", FRAMES)
    points = np.zeros((24, 3))
    points[:, 0] = 36 + np.arange(24) % 5 * 4
    points[:, 1] = 10 + np.arange(24) // 5 * 4
    points[:, 2] = np.linspace(0.2, 0.9, 24)
    points[APOLLO_24.index("front_wheel_left"), 2] = 0
    (tmp_path / "points").mkdir()
    (tmp_path / "points" / "000001.predictions.json").write_text(json.dumps([{"keypoints": points.ravel().tolist()}]))
    found = with_openpifpaf(tmp_path / "points", plain)
    left, right = found.detections
    assert left.keypoints is None
    assert found.keypoint_names("car") == tuple(APOLLO_FROM_OURS)
    for i, name in enumerate(APOLLO_FROM_OURS.values()):
        x, y, confidence = points[APOLLO_24.index(name)]
        assert right.keypoint_scores[i] == pytest.approx(confidence)
        if confidence > 0:
            assert right.keypoints[i] == pytest.approx([x, y])


def test_names_of_the_category_are_those_that_apollo_is_mapped_to():
    from meshslam.categories import load_category

    assert tuple(APOLLO_FROM_OURS) == load_category("car").keypoint_names


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("1 1003 1 48 64", "found 5 words"),
        ("1 1003 1 64 48 {counts}", "size"),
        ("1 1003 1 48 64 zz", "counts"),
        ("1 3003 3 48 64 {counts}", "class 3"),
        ("7 1003 1 48 64 {counts}", "frame 7"),
        ("1 one 1 48 64 {counts}", "one"),
    ],
)
def test_mots_lines_that_are_wrong_are_named_with_their_place(tmp_path, line, said):
    path = tmp_path / "mots.txt"
    path.write_text(line.format(counts=encode_mask(square(4, 4))["counts"]))
    with pytest.raises(DetectionError, match=rf"mots.txt:1: .*{said}"):
        from_mots_txt(path, FRAMES)


@pytest.mark.parametrize(
    ("name", "picture", "said"),
    [
        ("000001.png", np.full((48, 64), 3001, np.uint16), "class 3"),
        ("000001.png", np.zeros((64, 48), np.uint16), "shape"),
        ("000007.png", np.zeros((48, 64), np.uint16), "frame 7"),
        ("masks.png", np.zeros((48, 64), np.uint16), "frame number"),
        ("000001.txt", np.zeros((48, 64), np.uint16), "holds no file that ends in .png"),
    ],
)
def test_mots_pictures_that_are_wrong_are_named(tmp_path, name, picture, said):
    (tmp_path / name).write_bytes(cv2.imencode(".png", picture)[1].tobytes())
    with pytest.raises(DetectionError, match=said):
        from_mots_png(tmp_path, FRAMES)


@pytest.mark.parametrize("text", ["{", "3", '{"predictions": 1}', '[{"keypoints": [1, 2, 3]}]', '[{"bbox": []}]'])
def test_openpifpaf_files_that_are_wrong_are_named(tmp_path, text):
    (tmp_path / "points").mkdir()
    (tmp_path / "points" / "000001.predictions.json").write_text(text)
    with pytest.raises(DetectionError, match=r"000001.predictions.json: "):
        with_openpifpaf(tmp_path / "points", from_coco_results(_results(tmp_path), FRAMES))


def test_what_another_network_said_of_the_points_goes_with_them(tmp_path):
    """A car that OpenPifPaf does not find keeps no sigma and no viewing angle of points that are gone."""
    plain = from_coco_results(_results(tmp_path), FRAMES)
    (car,) = plain.detections
    pointed = replace(
        car,
        keypoints=np.ones((12, 2)),
        keypoint_scores=np.ones(12),
        keypoint_sigmas_px=np.ones(12),
        viewing_angle_shares=np.ones(36),
    )
    (tmp_path / "points").mkdir()
    (tmp_path / "points" / "000001.predictions.json").write_text("[]")
    (found,) = with_openpifpaf(tmp_path / "points", replace(plain, detections=(pointed,))).detections
    parts = (found.keypoints, found.keypoint_scores, found.keypoint_sigmas_px, found.viewing_angle_shares)
    assert all(part is None for part in parts)


def _results(folder):
    row = {"image_id": 1, "category_id": 3, "segmentation": encode_mask(square(4, 10, 20)), "score": 0.9}
    path = folder / "results.json"
    path.write_text(json.dumps([row]))
    return path


def test_every_converters_set_is_a_file_that_is_read_back(tmp_path):
    corners = "0.2 0.2 0.5 0.2 0.5 0.6"
    (tmp_path / "000001.txt").write_text(f"2 {corners} 0.8")
    (tmp_path / "mots").mkdir()
    (tmp_path / "mots" / "m.txt").write_text(f"1 1003 1 48 64 {encode_mask(square(4, 4))['counts']}")
    for found in (
        from_coco_results(_results(tmp_path), FRAMES),
        from_yolo_txt(tmp_path, FRAMES),
        from_mots_txt(tmp_path / "mots" / "m.txt", FRAMES),
    ):
        (tmp_path / "detections.json").write_bytes(write_detections(found))
        (again,), (first,) = read_detections(tmp_path / "detections.json").detections, found.detections
        assert (again.frame, again.category, again.track_id) == (first.frame, first.category, first.track_id)
        assert (again.mask() == first.mask()).all()
        assert again.mask().any()
