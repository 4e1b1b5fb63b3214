"""SO(3): exponential map, logarithm, right Jacobian (paper, Proposition 2)."""

from __future__ import annotations

import numpy as np

from meshslam import _core
from meshslam.geometry.arrays import Floats
from meshslam.geometry.native import floats, geometry_errors


def hat(a: Floats) -> Floats:
    """Cross product with a (3,) as a (3, 3) matrix: its product with b is a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def exp_so3(theta: Floats) -> Floats:
    """Rotation (3, 3) by the axis-angle vector theta (3,), radians."""
    with geometry_errors():
        return _core.exp_so3(floats(theta))


def log_so3(rotation: Floats) -> Floats:
    """Axis-angle vector (3,) of a rotation (3, 3), of length at most pi."""
    with geometry_errors():
        return _core.log_so3(floats(rotation))


def right_jacobian(theta: Floats) -> Floats:
    """J_r (3, 3) with exp(theta + delta) = exp(theta) exp(J_r(theta) delta) to first order."""
    with geometry_errors():
        return _core.right_jacobian(floats(theta))
