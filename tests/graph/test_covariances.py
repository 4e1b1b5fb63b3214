"""Covariances of several variables at once are those of each alone."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import O, X, Z

from meshslam.graph.window import Window


@pytest.fixture
def window(rng):
    """Two poses and a vector of objects about two cameras, with correlated factors of several variables."""
    window = Window()
    for key in (X(0), X(1), O(3), O(7)):
        window.values.insert(key, gtsam.Pose3.Expmap(rng.normal(0, 0.3, 6)))
    window.values.insert(Z(3), rng.normal(0, 1, 2))
    window.add(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 0.1)))
    window.add(gtsam.PriorFactorVector(Z(3), np.zeros(2), gtsam.noiseModel.Isotropic.Sigma(2, 1.0)))
    for a, b in ((X(0), X(1)), (X(0), O(3)), (X(1), O(3)), (X(1), O(7)), (O(3), O(7))):
        spread = rng.normal(0, 0.2, (6, 6))
        noise = gtsam.noiseModel.Gaussian.Covariance(spread @ spread.T + 0.01 * np.eye(6))
        window.add(gtsam.BetweenFactorPose3(a, b, gtsam.Pose3.Expmap(rng.normal(0, 0.3, 6)), noise))
    return window


@pytest.mark.parametrize("keys", [[O(3)], [O(7), O(3)], [X(1), Z(3), O(3), O(7)]], ids=len)
def test_each_is_that_of_the_variable_alone(window, keys):
    found = window.covariances(keys)
    assert found.keys() == set(keys)
    for key in keys:
        alone = window.covariance(key)
        assert np.abs(found[key] - alone).max() < 1e-9 * np.abs(alone).max()


def test_of_nothing_there_are_none(window):
    assert window.covariances([]) == {}
