"""SO(3): exponential map, logarithm, right Jacobian (paper, Proposition 2 and its proof, Eq. 14), batched."""

from __future__ import annotations

import numpy as np

from meshslam import _core
from meshslam.geometry.arrays import Floats
from meshslam.geometry.native import floats, geometry_errors


def hat(a: Floats) -> Floats:
    """Cross products with vectors (..., 3) as matrices (..., 3, 3): their product with b is a x b."""
    x, y, z = np.moveaxis(np.asarray(a, float), -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack(row, -1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))], -2)


def cross_matrix(v: Floats) -> Floats:
    """[v]x (3, 3) with [v]x w = v x w; one vector at a time, for which it is ten times as fast as `hat`."""
    x, y, z = v.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exp_so3(theta: Floats) -> Floats:
    """Rotations (..., 3, 3) by the axis-angle vectors theta (..., 3), radians; GeometryError for NaN."""
    with geometry_errors():
        return _core.exp_so3(floats(theta).reshape(-1, 3)).reshape(*np.shape(theta), 3)


def log_so3(rotation: Floats) -> Floats:
    """Axis-angle vectors (..., 3) of rotations (..., 3, 3), of length at most pi; GeometryError for NaN."""
    with geometry_errors():
        return _core.log_so3(floats(rotation).reshape(-1, 3, 3)).reshape(np.shape(rotation)[:-1])


def right_jacobian(theta: Floats) -> Floats:
    """J_r (..., 3, 3) of theta (..., 3): exp(theta + delta) = exp(theta) exp(J_r(theta) delta) to first order (Eq. 14).

    GeometryError for NaN.
    """
    with geometry_errors():
        return _core.right_jacobian(floats(theta).reshape(-1, 3)).reshape(*np.shape(theta), 3)
