"""Geman and McClure's kernel."""

import numpy as np
import pytest

from meshslam.errors import GeometryError
from meshslam.geometry import geman_mcclure, geman_mcclure_soft

SQUARED = np.concatenate([[0.0], np.geomspace(1e-6, 1e6, 49)])


@pytest.mark.parametrize("kernel", [0.3, 1.0, 3.0, 20.0])
def test_the_weight_is_the_derivative_of_the_cost(kernel):
    _, weight = geman_mcclure(SQUARED, kernel)
    step = 1e-5 * (SQUARED + kernel**2)
    slope = (geman_mcclure(SQUARED + step, kernel)[0] - geman_mcclure(SQUARED - step, kernel)[0]) / (2 * step)
    np.testing.assert_allclose(weight, slope, rtol=1e-6, atol=1e-10)


@pytest.mark.parametrize("kernel", [0.3, 3.0])
def test_the_cost_is_a_square_near_zero_and_bounded_far_away(kernel):
    cost, weight = geman_mcclure(SQUARED, kernel)
    assert geman_mcclure(0.0, kernel) == (0.0, 1.0)
    assert (np.diff(cost) > 0).all()
    assert (cost < kernel**2).all()
    assert (np.diff(weight) < 0).all()
    np.testing.assert_allclose(cost[1e-5 * kernel**2 > SQUARED], SQUARED[1e-5 * kernel**2 > SQUARED], rtol=1e-5)


def test_numbers_and_arrays_tell_the_same_to_the_bit():
    cost, weight = geman_mcclure(SQUARED, 3.0)
    for k, squared in enumerate(SQUARED.tolist()):
        assert geman_mcclure(squared, 3.0) == (cost[k], weight[k])


def test_what_localization_writes_is_the_same_to_the_bit():
    kernel, sigma, share = 2.7, 1.3, 0.4
    for squared in SQUARED.tolist():
        soft = geman_mcclure_soft(squared, kernel**2)
        assert soft**-2 == (1.0 + squared / kernel**2) ** -2  # of an alignment
        assert share / sigma**2 / soft**2 == share / sigma**2 / (1.0 + squared / kernel**2) ** 2  # of a gradient
    soft = geman_mcclure_soft(SQUARED, 5 * kernel**2)
    np.testing.assert_array_equal(soft, 1.0 + SQUARED / (5 * kernel**2))  # of a point factor with 5 degrees of freedom


@pytest.mark.parametrize("kernel", [0.0, -1.0, np.nan])
def test_a_threshold_must_be_positive(kernel):
    with pytest.raises(GeometryError, match="must be positive"):
        geman_mcclure(1.0, kernel)
    with pytest.raises(GeometryError, match="must be positive"):
        geman_mcclure_soft(1.0, kernel)
