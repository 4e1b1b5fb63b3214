"""Rotations as unit quaternions (x, y, z, w), many at a time."""

from __future__ import annotations

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry.arrays import Floats

_ORTHONORMAL = 1e-12  # of R R^T, beyond which the nearest rotation is taken


def rotations_of_quaternions(quaternions: Floats) -> Floats:
    """Matrices (n, 3, 3) of quaternions (n, 4), which are normalized; GeometryError for one of length 0.

    >>> rotations_of_quaternions(np.array([[0.0, 0.0, 2.0, 2.0]])).round(9).tolist()
    [[[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]
    """
    q = np.asarray(quaternions, float).reshape(-1, 4)
    lengths = np.sqrt(q[:, 0] * q[:, 0] + q[:, 1] * q[:, 1] + q[:, 2] * q[:, 2] + q[:, 3] * q[:, 3])
    if not (lengths > 0).all():
        raise GeometryError(f"a rotation's quaternion is not of length 0, found {q[~(lengths > 0)][0].tolist()}")
    x, y, z, w = (q / lengths[:, None]).T
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, zw, xz, yw, yz, xw = x * y, z * w, x * z, y * w, y * z, x * w
    rows = [
        [xx - yy - zz + ww, 2 * (xy - zw), 2 * (xz + yw)],
        [2 * (xy + zw), -xx + yy - zz + ww, 2 * (yz - xw)],
        [2 * (xz - yw), 2 * (yz + xw), -xx - yy + zz + ww],
    ]
    return np.ascontiguousarray(np.array(rows).transpose(2, 0, 1))


def quaternions_of_rotations(rotations: Floats) -> Floats:
    """Unit quaternions (n, 4) of matrices (n, 3, 3), w not negative (Shepperd 1978).

    A matrix that is no rotation is replaced by the nearest one; GeometryError where its determinant is not positive.

    >>> quaternions_of_rotations(np.eye(3)[None]).tolist()
    [[0.0, 0.0, 0.0, 1.0]]
    """
    matrices = np.asarray(rotations, float).reshape(-1, 3, 3)
    if not np.isfinite(matrices).all() or not (np.linalg.det(matrices) > 0).all():
        raise GeometryError("a rotation's determinant is positive: found a mirror, or values that are not finite")
    off = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) > _ORTHONORMAL
    if off.any():
        u, _, vt = np.linalg.svd(matrices[off])
        matrices = matrices.copy()
        matrices[off] = u @ vt
    found = np.array([_quaternion(rows) for rows in matrices.tolist()]).reshape(-1, 4)
    lengths = np.sqrt((found[:, 0] ** 2 + found[:, 1] ** 2) + found[:, 2] ** 2 + found[:, 3] ** 2)
    found /= lengths[:, None]
    return np.where(_points_back(found)[:, None], -found, found)


def _quaternion(m: list[list[float]]) -> list[float]:
    """Not normalized, from the largest of the four squares, so that nothing cancels."""
    trace = m[0][0] + m[1][1] + m[2][2]
    squares = [m[0][0], m[1][1], m[2][2], trace]
    i = squares.index(max(squares))
    if i == 3:
        return [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 1 + trace]
    j, k = (i + 1) % 3, (i + 2) % 3
    found = [0.0, 0.0, 0.0, m[k][j] - m[j][k]]
    found[i] = 1 - trace + 2 * m[i][i]
    found[j], found[k] = m[j][i] + m[i][j], m[k][i] + m[i][k]
    return found


def _points_back(q: Floats) -> Floats:
    """Whether w is negative; where it is 0, the first of x, y, z that is not 0."""
    x, y, z, w = q.T
    return np.asarray((w < 0) | ((w == 0) & ((x < 0) | ((x == 0) & ((y < 0) | ((y == 0) & (z < 0)))))))
