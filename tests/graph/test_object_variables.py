"""The prior of landmarks: one size variable for all of them."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import O, S, Z

from meshslam.geometry import Pose
from meshslam.graph.camera_states import CameraStates
from meshslam.graph.object_variables import ObjectVariables
from meshslam.graph.window import Window
from meshslam.motion import Mounting

MODES = 5
DIRECTION = np.array([0.6, 0.0, -0.8, 0.0, 0.0])  # in which an object grows, of unit length


def landmarks(count, size_sigma):
    """A window of landmarks that nothing has observed yet."""
    window = Window()
    objects = ObjectVariables(window, CameraStates(window, Mounting(Pose.identity())))
    for number in range(1, count + 1):
        objects.add_landmark(number, Pose.identity(), np.zeros(MODES), DIRECTION, size_sigma)
    return window


def measured(window, number, z, sigma):
    window.add(gtsam.PriorFactorVector(Z(number), z, gtsam.noiseModel.Isotropic.Sigma(MODES, sigma)))
    window.optimize(5)
    return window.values


@pytest.mark.parametrize("size_sigma", [0.5, 1.0, 2.0])
def test_a_large_car_makes_its_neighbours_likely_large(size_sigma):
    """z ~ N(s g, I), s ~ N(0, sigma^2): of a car that is m along g the others are m sigma^2 / (1 + sigma^2)."""
    values = measured(landmarks(3, size_sigma), 1, 1.7 * DIRECTION, 1e-3)
    shared = 1.7 * size_sigma**2 / (1 + size_sigma**2)
    assert values.atVector(S(0)) == pytest.approx(shared, rel=1e-3)
    for number in (2, 3):
        assert values.atVector(Z(number)) == pytest.approx(shared * DIRECTION, abs=1e-3)


def test_what_is_no_size_is_each_cars_own():
    across = np.array([0.8, 0.3, 0.6, -0.4, 0.0])
    assert across @ DIRECTION == pytest.approx(0)
    values = measured(landmarks(2, 1.0), 1, across, 1e-3)
    assert values.atVector(Z(2)) == pytest.approx(0, abs=1e-6)
    assert values.atVector(Z(1)) == pytest.approx(across, abs=1e-3)


def test_the_more_cars_agree_the_surer_is_the_size():
    """Of n cars measured exactly, the size has the variance 1 / (n + 1 / sigma^2)."""
    for count in (1, 4):
        window = landmarks(count, 1.0)
        for number in range(1, count + 1):
            measured(window, number, DIRECTION, 1e-4)
        assert window.covariance(S(0)) == pytest.approx(1 / (count + 1), rel=1e-3)


def test_one_car_alone_has_modes_of_unit_variance_but_for_the_size():
    found = landmarks(1, 2.0).covariance(Z(1))
    assert found == pytest.approx(np.eye(MODES) + 4.0 * np.outer(DIRECTION, DIRECTION), abs=1e-6)
    assert landmarks(1, 2.0).values.exists(O(1))
