"""Rigid transforms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry.arrays import Floats
from meshslam.geometry.lie import cross_matrix, exp_so3


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid transform, named `a_from_b`: it takes coordinates in b to coordinates in a.

    Tangent vectors of SE(3) are (translation, rotation); perturbations act on the right.
    """

    rotation: Floats  # (3, 3)
    translation: Floats  # (3,), metres

    @staticmethod
    def identity() -> Pose:
        """Return the transform that changes nothing."""
        return Pose(np.eye(3), np.zeros(3))

    @staticmethod
    def from_matrix(matrix: Floats) -> Pose:
        """Read a (4, 4) homogeneous matrix; GeometryError if it is no rigid transform (to 1e-4)."""
        m = np.asarray(matrix, float)
        if m.shape != (4, 4) or not np.isfinite(m).all():
            raise GeometryError(f"a pose is a finite 4x4 matrix, found shape {m.shape} with values {m.tolist()}")
        r = m[:3, :3]
        if np.abs(r.T @ r - np.eye(3)).max() > 1e-4 or np.linalg.det(r) < 0:
            raise GeometryError(f"a pose's rotation must be orthonormal with determinant 1, found {r.tolist()}")
        return Pose(nearest_rotation(r), m[:3, 3].copy())

    @staticmethod
    def from_yaw(yaw_rad: float, translation: Floats) -> Pose:
        """Turn by `yaw_rad` about z, then move by `translation` (3,)."""
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        return Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.asarray(translation, float))

    @property
    def matrix(self) -> Floats:
        """The (4, 4) homogeneous matrix."""
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = self.rotation, self.translation
        return m

    @property
    def yaw_rad(self) -> float:
        """Heading of the x axis about z."""
        return float(np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))

    def inverse(self) -> Pose:
        """`b_from_a` of this `a_from_b`."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def adjoint(self) -> Floats:
        """Ad (6, 6) with T exp(x) = exp(Ad x) T, over (translation, rotation)."""
        out = np.zeros((6, 6))
        out[:3, :3] = out[3:, 3:] = self.rotation
        out[:3, 3:] = cross_matrix(self.translation) @ self.rotation
        return out

    def retract(self, step: Floats) -> Pose:
        """Move by a right perturbation (translation, rotation)."""
        return Pose(self.rotation @ exp_so3(step[3:]), self.translation + self.rotation @ step[:3])

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def transform(self, points: Floats) -> Floats:
        """Take points (..., 3) from b to a."""
        moved: Floats = points @ self.rotation.T + self.translation
        return moved


def nearest_rotation(matrix: Floats) -> Floats:
    """Return the rotation nearest to a (3, 3) matrix in the Frobenius norm."""
    u, _, vt = np.linalg.svd(matrix)
    nearest: Floats = u @ np.diag([1.0, 1.0, float(np.sign(np.linalg.det(u @ vt)))]) @ vt
    return nearest
