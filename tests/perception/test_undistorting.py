"""Detections in raw pixels become those of the pinhole view; files that are in it already stay as they are."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshslam.geometry import Camera, mask_iou
from meshslam.perception import encode_mask, read_detections, read_recorded_detections, write_detections
from meshslam.sequences import Sequence, undistorted

RAW = Camera(320, 240, 150.0, 150.0, 159.5, 119.5)
FISHEYE, _ = undistorted(RAW, np.array([-0.02, 0.003, 0.0, 0.0]), "equidistant")
RADTAN, _ = undistorted(RAW, np.array([-0.2, 0.03, 0.001, -0.0005]))


def disc(camera_pixels, centre):
    """Pixels within a circle that is one in the pinhole view."""
    return (np.linalg.norm(camera_pixels - centre, axis=-1) < 25).astype(np.uint8)


def grid(camera):
    return np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1).astype(float)


def recording(lens):
    return Sequence("s", "folder", Path("s"), lens.camera, (0,), np.zeros(1), distortion=lens)


def written(tmp_path, masks, **more):
    images = [{"id": 0, "file_name": "000000.png", "width": RAW.width, "height": RAW.height}]
    rows = [
        {"id": i + 1, "image_id": 0, "category_id": 1, "track_id": 7 + i, "segmentation": encode_mask(m), **more}
        for i, m in enumerate(masks)
    ]
    categories = [{"id": 1, "name": "car", "keypoints": ["a", "b", "c"]}]
    path = tmp_path / "detections.json"
    path.write_text(json.dumps({"images": images, "categories": categories, "annotations": rows}))
    return path


@pytest.mark.parametrize("lens", [FISHEYE, RADTAN])
def test_masks_and_points_come_undistorted(lens, tmp_path):
    centre = np.array([95.0, 150.0])
    raw_mask = np.nan_to_num(lens.undistort(grid(RAW)), nan=-1e3)
    places = np.array([[95.0, 150.0], [110.0, 140.0], [90.0, 160.0]])
    raw = lens.distort(places)
    points = [v for (x, y), v in zip(raw, (2, 2, 0), strict=True) for v in (x, y, v)]
    path = written(tmp_path, [disc(raw_mask, centre)], keypoints=points, keypoint_sigmas_px=[1.0, 1.0, 1.0])
    found = read_recorded_detections(path, recording(lens))
    (seen,) = found.detections
    assert mask_iou(seen.mask(), disc(grid(lens.camera), centre)) > 0.97
    assert np.allclose(np.array(seen.bbox), [71, 126, 49, 49], atol=2.5)
    assert np.abs(seen.keypoints[:2] - places[:2]).max() < 1e-6
    assert (seen.keypoint_scores > 0).tolist() == [True, True, False]
    step = 1e-4 * np.eye(2)
    area = np.linalg.det((lens.distort(places[0] + step) - lens.distort(places[0] - step)) / 2e-4)
    assert seen.keypoint_sigmas_px[0] == pytest.approx(area**-0.5, rel=0.01)
    assert (seen.track_id, found.undistorted) == (7, True)
    assert "1 detections are undistorted into the camera's pinhole view" in " ".join(found.warnings)


def test_what_lies_outside_the_view_is_left_out_and_said(tmp_path):
    corner, middle = np.zeros((2, RAW.height, RAW.width), np.uint8)
    corner[:8, :8], middle[100:140, 140:180] = 1, 1
    points = [2.0, 2.0, 2, 160.0, 120.0, 2, 0, 0, 0]
    found = read_recorded_detections(written(tmp_path, [corner, middle], keypoints=points), recording(FISHEYE))
    assert [d.id for d in found.detections] == [2]
    assert (found.detections[0].keypoint_scores > 0).tolist() == [False, True, False]
    assert np.isfinite(found.detections[0].keypoints).all()
    assert any("1 lie outside it and are left out" in said for said in found.warnings)


def test_a_file_that_is_undistorted_stays_as_it_is(tmp_path):
    middle = np.zeros((RAW.height, RAW.width), np.uint8)
    middle[40:200, 20:300] = 1
    path = written(tmp_path, [middle])
    once = read_recorded_detections(path, recording(FISHEYE))
    path.write_bytes(write_detections(once))
    assert read_detections(path).undistorted
    twice = read_recorded_detections(path, recording(FISHEYE))
    assert (twice.detections[0].mask() == once.detections[0].mask()).all()
    assert (once.detections[0].mask() != middle).any()
    plain = write_detections(replace(once, undistorted=False))
    assert b"undistorted" not in plain
    assert b"undistorted" in path.read_bytes()
