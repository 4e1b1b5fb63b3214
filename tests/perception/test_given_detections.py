"""Detections that a stream is given are checked before they change anything."""

from dataclasses import fields, replace

import numpy as np
import pytest

from meshslam.errors import DetectionError
from meshslam.geometry import Camera
from meshslam.perception import Detection
from meshslam.perception.given_detections import checked_detections

CAMERA = Camera(30, 20, fx=50.0, fy=50.0, cx=15.0, cy=10.0)
MASK = np.zeros((20, 30), np.uint8)
MASK[5:12, 8:20] = 1
POINTS = {"keypoints": np.full((4, 2), 10.0), "keypoint_scores": np.array([0.9, 0.0, 0.5, 1.0])}
GOOD = replace(Detection.from_mask(MASK, id=3, frame=0, track_id=5), **POINTS)


def checked(*detections):
    return checked_detections(7, detections, CAMERA, {"car": 4})


def test_good_ones_stay_as_they_are():
    (kept,), notes = checked(GOOD)
    for field in fields(GOOD):
        assert np.array_equal(getattr(kept, field.name), getattr(GOOD, field.name)), field.name
    assert notes == ()


def test_a_key_point_of_score_0_may_be_anything():
    points = POINTS["keypoints"].copy()
    points[1] = np.nan
    assert len(checked(replace(GOOD, keypoints=points))[0]) == 1


def test_of_two_on_a_track_the_better_one_stays():
    worse, other = replace(GOOD, id=4, score=0.4), replace(GOOD, id=5, track_id=6)
    kept, notes = checked(worse, GOOD, other)
    assert [d.id for d in kept] == [3, 5]
    assert notes == ("frame 7: several detections on track 5: the one of the best score stays",)


def test_numbers_become_pythons_own():
    (kept,), _ = checked(replace(GOOD, score=np.float32(0.5), track_id=np.int64(5), bbox=np.array(GOOD.bbox)))
    assert (type(kept.score), type(kept.track_id), type(kept.bbox)) == (float, int, tuple)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"image_size": (10, 15)}, "15x10 px, expected the camera's 30x20 px"),
        ({"segmentation": {"size": [20, 30], "counts": "1"}}, "segmentation that has counts"),
        ({"segmentation": None}, "segmentation that is NoneType"),
        ({"bbox": (0.0, 0.0, np.inf, 1.0)}, "box of"),
        ({"bbox": (0.0, 0.0, -2.0, 1.0)}, "box of"),
        ({"score": np.nan}, "score of nan"),
        ({"score": 1.5}, "score of 1.5"),
        ({"track_id": "5"}, "track_id '5'"),
        (
            {"keypoints": POINTS["keypoints"][:3], "keypoint_scores": POINTS["keypoint_scores"][:3]},
            "3 key points, expect",
        ),
        ({"keypoint_scores": None}, "without keypoint_scores"),
        ({"keypoint_scores": np.array([np.nan, 0, 0, 0])}, "not finite"),
        ({"keypoint_sigmas_px": np.array([1.0, 1.0, -1.0, 1.0])}, "keypoint_sigmas_px"),
        ({"viewing_angle_shares": np.array([1.0, np.nan])}, "viewing_angle_shares"),
        ({"image_size": None}, "wrong type"),
    ],
)
def test_what_cannot_be_used_is_named(changes, said):
    with pytest.raises(DetectionError, match=f"frame 7: detection 3 .*{said}"):
        checked(replace(GOOD, **changes))
