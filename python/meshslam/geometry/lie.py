"""SO(3): exponential map, logarithm, right Jacobian (paper, Proposition 2 and its proof, Eq. 14), batched."""

from __future__ import annotations

import numpy as np

from meshslam import _core
from meshslam.geometry.arrays import Floats
from meshslam.geometry.native import floats, geometry_errors


def hat(a: Floats) -> Floats:
    """Skew-symmetric matrices (..., 3, 3) of vectors a (..., 3): their product with b is a x b.

    >>> hat(np.array([1.0, 2.0, 3.0])) @ np.array([0.0, 0.0, 1.0])
    array([ 2., -1.,  0.])
    """
    x, y, z = np.moveaxis(np.asarray(a, float), -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack(row, -1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))], -2)


def cross_matrix(v: Floats) -> Floats:
    """The skew-symmetric matrix (3, 3) of one vector v (3,): its product with w is v x w.

    It equals `hat(v)`, and is about ten times as fast for one vector. ValueError if v has not three entries.

    >>> cross_matrix(np.array([1.0, 2.0, 3.0])) @ np.array([0.0, 0.0, 1.0])
    array([ 2., -1.,  0.])
    """
    x, y, z = v.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exp_so3(theta: Floats) -> Floats:
    """Rotations (..., 3, 3) by the axis-angle vectors theta (..., 3), radians (Rodrigues' formula).

    GeometryError for another shape, or a value that is not finite.

    >>> exp_so3(np.array([0.0, 0.0, np.pi / 2])).round(9) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    with geometry_errors():
        return _core.exp_so3(floats(theta).reshape(-1, 3)).reshape(*np.shape(theta), 3)


def log_so3(rotation: Floats) -> Floats:
    """Axis-angle vectors (..., 3) of rotations (..., 3, 3), radians, of length at most pi; exact also near pi.

    GeometryError for another shape, or a value that is not finite. Whether the matrices are rotations is not checked.

    >>> log_so3(exp_so3(np.array([0.1, -0.2, 0.3]))).round(9)
    array([ 0.1, -0.2,  0.3])
    """
    with geometry_errors():
        return _core.log_so3(floats(rotation).reshape(-1, 3, 3)).reshape(np.shape(rotation)[:-1])


def right_jacobian(theta: Floats) -> Floats:
    """J_r (..., 3, 3) of theta (..., 3), radians: exp(theta + delta) = exp(theta) exp(J_r(theta) delta) to first order.

    The paper's Eq. 14. The left Jacobian, SE(3)'s V, is `right_jacobian(-theta)`. GeometryError for another shape, or a
    value that is not finite.
    """
    with geometry_errors():
        return _core.right_jacobian(floats(theta).reshape(-1, 3)).reshape(*np.shape(theta), 3)


def right_jacobian_inverse(theta: Floats) -> Floats:
    """The inverse (..., 3, 3) of `right_jacobian`, for theta (..., 3) shorter than 2 pi radians.

    GeometryError for another shape, or a value that is not finite.
    """
    with geometry_errors():
        return _core.right_jacobian_inverse(floats(theta).reshape(-1, 3)).reshape(*np.shape(theta), 3)
