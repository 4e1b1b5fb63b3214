"""The correction of step lengths from images on: a textured road between walls."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.features import FrameImage, LengthConfig, RoadConfig, correct_lengths
from meshslam.features.length_evidence import road_factor
from meshslam.maps import CameraPath
from meshslam.perception import grey
from tests.fixtures.walled_road import CAMERA, HEIGHT_M, drive, image, lengths_m, texture, with_ratios

COUNT = 10
CONFIG = LengthConfig(points=200)
TRUE = drive(np.linspace(0.7, 0.85, COUNT), turn_rad=0.002)
NOTHING = dict.fromkeys(range(COUNT + 1), ())


@pytest.fixture(scope="module")
def images():
    paint = texture()
    return [image(pose, paint) for pose in TRUE]


def corrected(images, given, height_m=HEIGHT_M):
    frames = CameraPath(CAMERA, tuple(range(COUNT + 1)), 0.1 * np.arange(COUNT + 1), given, height_m)
    return frames, correct_lengths(frames, images.__getitem__, NOTHING, CONFIG, lambda _frames: None)


def test_right_poses_come_back_as_they_are(images):
    frames, found = corrected(images, TRUE)
    assert found.frames.world_from_camera is frames.world_from_camera
    assert not found.notes


def test_a_wrong_step_is_corrected(images):
    _, found = corrected(images, with_ratios(TRUE, np.where(np.arange(COUNT) == 4, 1.16, 1.0)))
    np.testing.assert_allclose(lengths_m(found.frames.world_from_camera) / lengths_m(TRUE), 1.0, atol=0.02)
    assert len(found.notes) == 1
    assert "1 step length corrected" in found.notes[0]


@pytest.mark.parametrize("factor", [0.85, 1.0, 1.15])
def test_the_road_tells_the_factor_of_a_path_where_most_pairs_of_frames_show_it(images, factor):
    given, config = with_ratios(TRUE, np.full(COUNT, factor)), RoadConfig(min_baseline_m=1.4)
    seen = [FrameImage(grey(one), np.ones(one.shape[:2], np.uint8)) for one in images]
    found = road_factor(seen, given, CAMERA, HEIGHT_M, 0.02, config)
    assert found.value == pytest.approx(-np.log(factor), abs=0.015)
    assert found.sigma >= 0.02
    hidden = [replace(one, free=np.zeros_like(one.free)) if k > 4 else one for k, one in enumerate(seen)]
    assert road_factor(hidden, given, CAMERA, HEIGHT_M, 0.02, config) is None


def test_a_drift_is_corrected_by_the_road(images):
    given = with_ratios(TRUE, 0.9 / lengths_m(TRUE))
    _, found = corrected(images, given)
    np.testing.assert_allclose(lengths_m(found.frames.world_from_camera) / lengths_m(TRUE), 1.0, atol=0.03)
    frames, found = corrected(images, given, height_m=None)  # the road without a height tells nothing
    assert found.frames.world_from_camera is frames.world_from_camera
    assert "nothing was corrected" in found.notes[0]
