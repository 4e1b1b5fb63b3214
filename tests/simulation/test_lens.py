from dataclasses import replace

import numpy as np
import pytest

from meshslam.geometry import mask_iou
from meshslam.perception import read_recorded_detections
from meshslam.sequences import check_sequence, open_sequence
from meshslam.simulation import (
    EXACT,
    StreetConfig,
    make_street,
    observe,
    render_image,
    write_recording,
)
from meshslam.simulation.render import draw
from meshslam.simulation.street import street_lens

FISHEYE = StreetConfig(width_px=400, height_px=160, lens="equidistant", field_deg=150.0)


@pytest.fixture(scope="module")
def fisheye(street):
    lens = street_lens(FISHEYE)
    two = {"times_s": street.times_s[:2], "world_from_camera": street.world_from_camera[:2]}
    return replace(street, camera=lens.camera, distortion=lens, **two)


@pytest.fixture(scope="module")
def folder(fisheye, tmp_path_factory):
    return write_recording(fisheye, tmp_path_factory.mktemp("fisheye") / "a", EXACT)


def test_the_folder_is_a_sound_sequence_of_a_fisheye(fisheye, folder):
    assert [p.severity for p in check_sequence(folder)] == ["note"]
    recording = open_sequence(folder)
    assert recording.distortion.model == "equidistant"
    assert recording.camera == fisheye.camera
    assert recording.raw_camera.fx == pytest.approx(400 / np.radians(150))
    assert recording.distortion.black_share() == 0.0


def test_undistorted_it_is_what_a_pinhole_camera_sees(fisheye, folder):
    recording, pinhole = open_sequence(folder), replace(fisheye, distortion=None)
    given = read_recorded_detections(recording.detections_path, recording).by_frame()[1]
    difference = recording.read_image(1).astype(float) - render_image(pinhole, 1)
    assert np.abs(difference).mean() < 6.0  # the raw image's sides have half the resolution
    assert abs(difference.mean()) < 0.5
    drawn, (expected, car_of), car_of_given = draw(pinhole, 1), observe(pinhole, EXACT), observe(fisheye, EXACT)[1]
    points = {car_of[d.id]: d for d in expected.by_frame()[1]}
    assert len(given) >= 3
    for detection in given:
        car = car_of_given[detection.id]
        mask = (drawn.object_index == car - 1).astype(np.uint8)
        assert mask_iou(detection.mask(), mask) > 0.9
        both = (detection.keypoint_scores > 0) & (points[car].keypoint_scores > 0)
        assert np.abs(detection.keypoints - points[car].keypoints)[both].max(initial=0.0) < 0.05


@pytest.mark.parametrize("mode", ["contrast", "textureless"])
def test_every_mode_is_drawn_behind_the_camera_too(mode, car):
    wide = {"width_px": 100, "height_px": 100, "field_deg": 220.0, "frames": 1, "cars_each_side": 1, "moving_cars": 0}
    street = make_street(car, 3, replace(FISHEYE, mode=mode, **wide))
    image, drawn = render_image(street, 0), draw(street, 0)
    assert image.shape == (100, 100, 3)
    edges = street.distortion.raw_rays(np.array([[0.0, 50.0], [99.0, 50.0]]))
    assert (edges[:, 2] < 0).all()
    assert (drawn.object_index[50, [0, 99]] >= 0).all()
    assert (image[50, [0, 99]] > 0).all()
