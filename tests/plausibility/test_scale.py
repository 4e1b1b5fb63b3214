"""Depths by parallax against depths by size."""

import numpy as np
import pytest

from meshslam.geometry import Camera, Pose
from meshslam.perception import Detection
from meshslam.plausibility import judge_scale

CAMERA = Camera(1242, 375, 720.0, 720.0, 610.0, 173.0)
FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
HEIGHT_M, STEP_M = 1.5, 1.0


def seen(speed_ratio=0.0, scale=1.0, count=6):
    """Findings for cars that come at a share of the camera's speed, with poses of a scale."""
    poses = {i: Pose(FORWARD, np.array([scale * STEP_M * i, 0.0, 1.65])) for i in range(count)}
    tracks = {}
    for number, aside in enumerate((3.0, -4.0, 5.0)):
        for i in range(count):
            depth = 18.0 - (1 + speed_ratio) * STEP_M * i
            x, y = (720.0 * v / depth for v in (-aside, 1.65 - HEIGHT_M / 2))
            h = 720.0 * HEIGHT_M / depth
            box = (610.0 + x - h, 173.0 + y - h / 2, 2 * h, h)
            row = Detection(len(tracks) * 100 + i, i, "car", 0.9, box, None, (375, 1242))
            tracks.setdefault(number, []).append(row)
    return judge_scale(CAMERA, poses, tracks, {"car": HEIGHT_M}, "poses.tum")


def test_parked_cars_and_poses_in_metres_say_nothing():
    assert seen() == []


@pytest.mark.parametrize("scale", [0.1, 2.5, 1000.0])
def test_poses_that_are_not_in_metres_are_an_error(scale):
    [finding] = seen(scale=scale)
    assert finding.severity == "error"
    assert finding.figures["scale"] == pytest.approx(scale, rel=0.05)


def test_oncoming_cars_are_noted_and_no_error():
    [finding] = seen(speed_ratio=1.0)
    assert finding.severity == "note"
    assert finding.figures["scale"] == pytest.approx(0.5, rel=0.05)
    assert "oncoming" in finding.message
