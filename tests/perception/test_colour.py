"""Masks and key points read back from pixels whose colours say what they are."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from meshslam.geometry import mask_iou
from meshslam.perception import ColourConfig, ColourSegmenter, detect
from meshslam.perception.colour_code import HUES, body_colour_bgr, point_colour_bgr, read_colours
from meshslam.simulation import EXACT, StreetConfig, make_street, observe, procedural_bodies, render_image

SMALL = StreetConfig(frames=3, width_px=640, height_px=200, focal_px=400.0, cars_each_side=3, mode="contrast")


@pytest.fixture(scope="module")
def street():
    return make_street(procedural_bodies(5, 7), 5, SMALL)


@pytest.mark.parametrize("light", [0.3, 0.6, 1.0])
def test_every_colour_reads_as_what_it_says_in_light_and_shade(light):
    for number in range(HUES):
        for colour, is_point in ((body_colour_bgr(number), False), (point_colour_bgr(number), True)):
            image = np.full((2, 2, 3), np.round(255 * light * colour), np.uint8)
            hue, bodies, points = read_colours(image)
            assert (hue == number).all()
            assert points.all() == is_point
            assert bodies.all() != is_point
    grey = np.full((2, 2, 3), round(255 * light), np.uint8)
    assert not any(part.any() for part in read_colours(grey)[1:])


def test_masks_and_key_points_are_those_that_were_drawn(street):
    segmenter = ColourSegmenter(ColourConfig(identities=True))
    found = detect(((i, render_image(street, i)) for i in range(3)), segmenter)
    exact, car_of = observe(street, EXACT)
    assert found.keypoint_names("car") == exact.keypoint_names("car")
    gaps, there = [], 0
    for truth in exact.detections:
        same = [d for d in found.by_frame()[truth.frame] if d.track_id == car_of[truth.id]]
        assert len(same) == 1
        assert mask_iou(same[0].mask(), truth.mask()) > 0.97
        seen = (same[0].keypoint_scores > 0) & (truth.keypoint_scores > 0)
        there += int((truth.keypoint_scores > 0).sum()) if truth.bbox[2] > 60 else 0
        gaps += np.linalg.norm(same[0].keypoints - truth.keypoints, axis=1)[seen].tolist()
    assert len(gaps) > 0.7 * there
    assert np.median(gaps) < 0.7
    assert np.quantile(gaps, 0.95) < 2.5


def test_a_body_behind_a_post_is_one_and_two_of_a_hue_far_apart_are_two():
    image = np.full((100, 400, 3), 90, np.uint8)
    colour = np.round(200 * body_colour_bgr(4))
    image[30:70, 20:120] = colour
    image[:, 60:66] = 90
    image[40:60, 300:350] = colour
    found = ColourSegmenter().segment(image)
    assert [instance.bbox for instance in found] == [(20.0, 30.0, 100.0, 40.0), (300.0, 40.0, 50.0, 20.0)]
    assert found[0].mask[:, 62].sum() == 0


def test_compressed_pictures_are_read_too(street):
    image = render_image(street, 0)
    clean = ColourSegmenter().segment(image)
    done, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])
    assert done
    rough = ColourSegmenter().segment(cv2.imdecode(code, cv2.IMREAD_COLOR))
    for instance in clean[:3]:
        assert max(mask_iou(instance.mask, other.mask) for other in rough) > 0.9


def test_a_grey_world_holds_nothing(street):
    assert ColourSegmenter().segment(render_image(replace(street, cars=()), 0)) == []
