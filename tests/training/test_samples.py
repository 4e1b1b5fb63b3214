"""Drawn crops and their labels."""

import numpy as np
import pytest

from meshslam.perception.keypoints.mirror import MIRRORED
from meshslam.simulation.cars import make_cars
from meshslam.training.augment import varied
from meshslam.training.dataset import Samples
from meshslam.training.pictures import Album, draw_pictures, packed, samples_of


@pytest.fixture(scope="module")
def cars():
    return make_cars(3, 2)


@pytest.fixture(scope="module")
def samples(cars):
    rng = np.random.default_rng(4)
    album = Album(packed(draw_pictures(rng, cars, 12)))
    return samples_of(rng, album, range(12))


def test_the_same_seed_draws_the_same(cars):
    first, again = (vars(packed(draw_pictures(np.random.default_rng(4), cars, 3))) for _ in range(2))
    for key, value in first.items():
        assert np.array_equal(value, again[key]), key


def test_visible_key_points_lie_on_or_near_the_mask(samples):
    near = []
    for cut, points, visible in zip(samples.cuts, samples.keypoints, samples.visible, strict=True):
        rows, columns = np.nonzero(cut[..., 3] > 127)
        for x, y in points[visible > 0]:
            near.append(np.hypot(columns - x, rows - y).min())
    assert len(near) > 20
    assert np.mean(np.array(near) < 6) > 0.85  # masks are roughened, and parts of some are missing


def test_left_and_right_show_at_the_angles_that_the_label_says(samples):
    """From the left of a car (pi / 2) its left wheels are seen, not its right ones."""
    for angle, visible in zip(samples.angles_rad, samples.visible, strict=True):
        if np.sin(angle) > 0.5:
            assert not visible[2:4].any()
        if np.sin(angle) < -0.5:
            assert not visible[:2].any()


def test_mirroring_twice_is_nothing():
    assert (MIRRORED[MIRRORED] == np.arange(12)).all()


def test_labels_follow_the_picture_when_it_is_varied():
    """A bright spot at each of the visible points is found at the varied points."""
    rng = np.random.default_rng(5)
    points = rng.uniform([30, 25], [95, 70], (40, 12, 2)).round()
    visible = np.zeros((40, 12))
    visible[np.arange(40), rng.integers(0, 12, 40)] = 1
    cuts = np.zeros((40, 96, 128, 4), np.uint8)
    for cut, spots, shown in zip(cuts, points, visible, strict=True):
        x, y = spots[shown > 0][0].astype(int)
        cut[y - 1 : y + 2, x - 1 : x + 2, 3] = 255
    angles = rng.uniform(-3, 3, 40)
    changed = varied(rng, Samples(cuts, points, visible, angles, np.ones((40, 2))))
    found = 0
    for i in range(40):
        plane = changed.cuts[i][..., 3].astype(float)
        if changed.visible[i].sum() != 1 or not 0 < plane.sum() < 20 * 255:
            continue  # a part was erased
        rows, columns = np.indices(plane.shape)
        middle = np.array([(plane * columns).sum(), (plane * rows).sum()]) / plane.sum()
        assert np.linalg.norm(middle - changed.keypoints[i][changed.visible[i] > 0][0]) < 1.0
        found += 1
    assert found > 20
    assert np.allclose(np.abs(changed.angles_rad), np.abs(angles))
