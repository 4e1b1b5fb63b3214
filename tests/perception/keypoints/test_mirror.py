"""A second look in the mirror."""

import numpy as np
import pytest

from meshslam.perception.keypoints.decode import ANGLES, CELL_PX, KEYPOINTS, angle_distribution, points_in_input
from meshslam.perception.keypoints.mirror import MIRRORED, answers_of, mirrored, undecided

SIZE = (24, 32)


def peaked(*angles_rad, weights=(1.0,)):
    """Logits of a distribution with peaks at these angles."""
    centres = 2 * np.pi * np.arange(ANGLES) / ANGLES
    shares = sum(w * np.exp(20 * (np.cos(a - centres) - 1)) for a, w in zip(angles_rad, weights, strict=True))
    return np.log(shares + 1e-9)[None].astype(np.float32)


def answers(rng, angle):
    heat = rng.normal(0, 3, (len(angle), KEYPOINTS, *SIZE)).astype(np.float32)
    visible, log_sigma = rng.normal(0, 1, (2, len(angle), KEYPOINTS)).astype(np.float32)
    return heat, visible, log_sigma, angle


def test_in_the_mirror_left_is_right(rng):
    first = answers(rng, peaked(0.7))
    second = mirrored(first)
    points, swapped = points_in_input(first[0])[0][0], points_in_input(second[0])[0][0]
    width = CELL_PX * SIZE[1]
    assert swapped == pytest.approx(([width - 1, 0] + points * [-1, 1])[MIRRORED], abs=1e-4)
    assert np.argmax(second[3][0]) == ANGLES - np.argmax(first[3][0])
    for one, twice in zip(first, mirrored(second), strict=True):
        assert np.array_equal(one, twice)


def test_two_ways_round_are_undecided_and_one_is_not():
    assert undecided(peaked(0.3, 0.3 + np.pi, weights=(0.8, 0.2))).all()
    assert not undecided(peaked(0.3, 0.3 + np.pi, weights=(0.99, 0.01))).any()
    assert not undecided(peaked(0.3, 0.9, weights=(0.6, 0.4))).any()


def test_only_undecided_crops_are_looked_at_again_and_the_mean_counts(rng):
    doubtful, sure = peaked(0.3, 0.3 + np.pi, weights=(0.55, 0.45)), peaked(2.0)
    looks = [answers(rng, np.concatenate([sure, doubtful])), answers(rng, peaked(-0.3 - np.pi))]
    given = [tuple(part.copy() for part in look) for look in looks]
    asked = []

    def network(crops):
        asked.append(crops)
        return looks[len(asked) - 1]

    crops = rng.normal(0, 1, (2, 4, 96, 128)).astype(np.float32)
    found = answers_of(network, crops)
    assert len(asked) == 2
    assert np.array_equal(asked[1], crops[1:, :, :, ::-1])
    for part, first, second in zip(found, given[0], mirrored(given[1]), strict=True):
        assert np.array_equal(part[0], first[0])
        assert part[1] == pytest.approx((first[1] + second[0]) / 2)
    facing = angle_distribution(found[3])[1].argmax() * 2 * np.pi / ANGLES
    assert np.cos(facing - 0.3 - np.pi) > 0.98  # the mirror has settled it
