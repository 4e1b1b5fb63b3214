"""The unit of a path by the sizes of cars."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.mapping import MappingConfig, size_of_cars
from meshslam.mapping.sizes import LOG_FACTORS, log_factor
from meshslam.objects import ObjectConfig


def valley(k, sigma):
    """What a car costs that knows its factor e^k to sigma."""
    return 0.5 * ((LOG_FACTORS - k) / sigma) ** 2


@pytest.mark.parametrize("k", [-0.2, 0.0, 0.15])
def test_cars_that_agree_tell_their_factor(k):
    value, sigma = log_factor([valley(k, 0.05)] * 4)
    assert value == pytest.approx(k, abs=0.02)
    assert 0.06 < sigma < 0.1
    assert log_factor([valley(k, 0.05)])[1] > sigma


def test_one_car_far_off_counts_little():
    alike = [valley(0.1, 0.05)] * 5
    assert log_factor([*alike, valley(-0.3, 0.03)])[0] == pytest.approx(log_factor(alike)[0], abs=0.04)


def test_a_car_that_tells_nothing_makes_no_claim():
    flat = np.zeros(len(LOG_FACTORS))
    value, sigma = log_factor([flat])
    assert abs(value) < 1e-9
    assert sigma > 0.2
    assert log_factor([flat, valley(0.1, 0.05)]) == pytest.approx(log_factor([valley(0.1, 0.05)]), abs=0.06)


def test_a_path_too_long_is_found_too_long(frames, tracked, car):
    """The street's own cars: sizes of the category, seen with noise."""
    first = frames.world_from_camera[0].translation

    def told(factor):
        poses = tuple(Pose(p.rotation, first + factor * (p.translation - first)) for p in frames.world_from_camera)
        along = replace(frames, world_from_camera=poses)
        return size_of_cars(along, tracked, car, ObjectConfig(), MappingConfig(), most=3)

    right, _, count = told(1.0)
    long, sigma, _ = told(1.25)
    assert count >= 2
    assert abs(right) < 2 * sigma
    assert abs(long + np.log(1.25)) < 2 * sigma
    assert long < right - 0.1


def test_without_cars_there_is_no_answer(frames, tracked, car, only):
    nothing = only(tracked)
    assert size_of_cars(frames, nothing, car, ObjectConfig(), MappingConfig(), most=3) is None
    assert size_of_cars(frames, tracked, car, ObjectConfig(), MappingConfig(), most=0) is None
