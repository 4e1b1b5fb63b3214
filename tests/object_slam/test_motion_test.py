"""A velocity is found where there is one, and only there."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshslam.object_slam.motion_test import LinearView, fit_velocity

MODES = 4


def views(rng, rotation, velocity, step):
    """Linear views of an object that is off by `step` (6 + modes) and moves, with noise of one."""
    out = []
    for time_s in np.arange(12) * 0.1:
        jacobian = rng.normal(size=(9, 6 + MODES)) * [20.0] * 1
        moved = step.copy()
        moved[:3] += rotation.T @ velocity * (time_s - 0.55)
        out.append(LinearView(time_s, jacobian, rng.normal(size=9) - jacobian @ moved))
    return out


@pytest.mark.parametrize("seed", range(5))
def test_what_moves_is_told_from_what_stands(seed):
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=seed).as_matrix()
    z, step = rng.normal(size=MODES), rng.normal(size=6 + MODES) * 0.1
    velocity = rng.normal(size=3) * 3
    found, gain = fit_velocity(views(rng, rotation, velocity, step), rotation, z)
    assert found == pytest.approx(velocity, abs=0.3)
    assert gain > 25
    found, gain = fit_velocity(views(rng, rotation, np.zeros(3), step), rotation, z)
    assert gain < 10
