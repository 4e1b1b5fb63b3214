"""Pictures as they are kept, and samples taken of them."""

import numpy as np
import pytest

from meshslam.simulation.cars import make_cars
from meshslam.training.pictures import Album, draw_chunk, draw_pictures, packed, samples_of


@pytest.fixture(scope="module")
def drawn():
    return draw_pictures(np.random.default_rng(8), make_cars(5, 2), 4)


@pytest.fixture(scope="module")
def album(drawn):
    return Album(packed(drawn))


def test_a_picture_comes_back_as_it_was_drawn(drawn, album):
    assert len(album) == len(drawn)
    for i, picture in enumerate(drawn):
        back = album[i]
        for key in ("mask", "others", "visible", "keypoints", "whole_px", "viewing_angle_rad"):
            assert np.array_equal(getattr(back, key), getattr(picture, key)), key
        light = np.clip(picture.image_bgr, 0, 3.0)
        assert np.abs(np.sqrt(back.image_bgr) - np.sqrt(light)).max() < 0.004  # half a step of a byte


def test_the_same_numbers_take_the_same_samples_and_others_take_others(album):
    first, again, other = (samples_of(np.random.default_rng(seed), album, range(4)) for seed in (1, 1, 2))
    assert np.array_equal(first.cuts, again.cuts)
    assert not np.array_equal(first.cuts, other.cuts)


def test_a_picture_of_which_too_little_is_seen_gives_way_to_another(drawn):
    from dataclasses import replace

    hidden = replace(drawn[0], mask=np.zeros_like(drawn[0].mask))
    samples = samples_of(np.random.default_rng(3), Album(packed([hidden, drawn[1]])), [0, 0, 0])
    assert (samples.angles_rad == drawn[1].viewing_angle_rad).all()


def test_the_box_is_that_of_the_pixels_that_are_seen(album):
    """Whatever a segmenter makes of them: the box's longer side says how far a key point may be off."""
    samples = samples_of(np.random.default_rng(6), album, [0] * 30)
    sides = samples.boxes_px.max(1)
    assert ((sides > 30) & (sides < 140)).all()


def test_a_chunk_is_of_the_vehicles_that_it_is_asked_for():
    made = []

    def make(seed, count):
        made.append((seed, count))
        return make_cars(5, 1)

    first, other = draw_chunk(3, 2, 1, make), draw_chunk(4, 2, 1, make)
    assert len(first) == 2
    assert made[0] != made[1]
    assert not np.array_equal(first.angles_rad, other.angles_rad)
