"""Rotations as unit quaternions (x, y, z, w), many at a time; by SciPy."""

from __future__ import annotations

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry.arrays import Floats


def rotations_of_quaternions(quaternions: Floats) -> Floats:
    """Matrices (n, 3, 3) of quaternions (n, 4), which are normalized; GeometryError for one of length 0.

    >>> rotations_of_quaternions(np.array([[0.0, 0.0, 2.0, 2.0]])).round(9).tolist()
    [[[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]
    """
    from scipy.spatial.transform import Rotation

    q = np.asarray(quaternions, float).reshape(-1, 4)
    zero = ~(np.linalg.norm(q, axis=1) > 0)
    if zero.any():
        raise GeometryError(f"a rotation's quaternion is not of length 0, found {q[zero][0].tolist()}")
    found: Floats = Rotation.from_quat(q).as_matrix().reshape(-1, 3, 3)
    return found


def quaternions_of_rotations(rotations: Floats) -> Floats:
    """Unit quaternions (n, 4) of matrices (n, 3, 3), w not negative.

    A matrix that is no rotation is replaced by the nearest one; GeometryError where its determinant is not positive.

    >>> quaternions_of_rotations(np.eye(3)[None]).tolist()
    [[0.0, 0.0, 0.0, 1.0]]
    """
    from scipy.spatial.transform import Rotation

    matrices = np.asarray(rotations, float).reshape(-1, 3, 3)
    if not np.isfinite(matrices).all() or not (np.linalg.det(matrices) > 0).all():
        raise GeometryError("a rotation's determinant is positive: found a mirror, or values that are not finite")
    found: Floats = Rotation.from_matrix(matrices).as_quat(canonical=True).reshape(-1, 4)
    return found
