"""Rigid transforms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry.arrays import Floats
from meshslam.geometry.lie import cross_matrix, exp_so3, log_so3, right_jacobian, right_jacobian_inverse
from meshslam.geometry.quaternions import quaternions_of_rotations, rotations_of_quaternions

_ROUNDING = 1e-14  # by which products of a rotation's numbers may be off
QuaternionOrder = Literal["xyzw", "wxyz"]  # where the real part w stands


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid transform, named `a_from_b`: it takes coordinates in b to coordinates in a.

    Tangent vectors of SE(3) are (translation, rotation), metres and radians; perturbations act on the right.

    >>> world_from_car = Pose.from_yaw(np.pi / 2, np.array([10.0, 0.0, 0.0]))
    >>> world_from_car.transform(np.array([1.0, 0.0, 0.0])).round(9)
    array([10.,  1.,  0.])
    """

    rotation: Floats  # (3, 3)
    translation: Floats  # (3,), metres

    @staticmethod
    def identity() -> Pose:
        """Return the transform that changes nothing."""
        return Pose(np.eye(3), np.zeros(3))

    @staticmethod
    def from_matrix(matrix: Floats) -> Pose:
        """Read a (4, 4) homogeneous matrix; GeometryError if it is no rigid transform (to 1e-4).

        Its rotation is replaced by the nearest one.
        """
        m = np.asarray(matrix, float)
        if m.shape != (4, 4) or not np.isfinite(m).all():
            raise GeometryError(
                f"a pose is a finite 4x4 matrix, found shape {m.shape} with values {str(m.tolist())[:80]}"
            )
        r = m[:3, :3]
        if np.abs(r.T @ r - np.eye(3)).max() > 1e-4 or np.linalg.det(r) < 0:
            raise GeometryError(f"a pose's rotation must be orthonormal with determinant 1, found {r.tolist()}")
        return Pose(nearest_rotation(r), m[:3, 3].copy())

    @staticmethod
    def restored(matrix: Floats) -> Pose:
        """The pose whose `matrix` this was, to the last bit; GeometryError as of `from_matrix`."""
        Pose.from_matrix(matrix)
        m = np.array(matrix, float)
        return Pose(m[:3, :3], m[:3, 3])

    @staticmethod
    def from_yaw(yaw_rad: float, translation: Floats) -> Pose:
        """Turn by `yaw_rad` about z, then move by `translation` (3,), metres."""
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        return Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.asarray(translation, float))

    @staticmethod
    def from_quaternion(quaternion: Floats, translation: Floats, *, order: QuaternionOrder) -> Pose:
        """Turn by a quaternion (4,), which is normalized, then move by `translation` (3,), metres.

        `order` says where the real part w stands. GeometryError for a wrong shape or order, a value that is not finite,
        or a quaternion whose length is 0 or beyond what can be squared.

        >>> pose = Pose.from_quaternion(np.array([0.0, 0.0, 2.0, 2.0]), np.zeros(3), order="xyzw")
        >>> round(pose.yaw_rad / np.pi, 9)
        0.5
        """
        q = _vector("a quaternion", quaternion, 4)
        if not 1e-200 < float(q @ q) < 1e200:
            raise GeometryError(f"a quaternion's length is positive and can be squared, found {q.tolist()}")
        xyzw = q if _real_part_is_last(order) else np.roll(q, -1)
        return Pose(rotations_of_quaternions(xyzw[None])[0], _vector("a translation", translation, 3))

    @staticmethod
    def exp(tangent: Floats) -> Pose:
        """The exponential of SE(3) at a tangent vector (6,): translation rho, metres, then rotation phi, radians.

        The result is (exp(phi), V(phi) rho) with the left Jacobian V of SO(3): the pose that is reached by moving with
        the constant body velocity (rho, phi) for the time 1. It holds near 0 and near pi. GeometryError for a wrong
        shape, or a value that is not finite.

        >>> quarter_circle = Pose.exp(np.array([np.pi / 2, 0.0, 0.0, 0.0, 0.0, np.pi / 2]))
        >>> quarter_circle.translation.round(9)
        array([1., 1., 0.])
        """
        x = _vector("a tangent vector", tangent, 6)
        return Pose(exp_so3(x[3:]), right_jacobian(-x[3:]) @ x[:3])

    def log(self) -> Floats:
        """The tangent vector (6,) whose `exp` this is: translation, metres, then rotation of at most pi, radians.

        It holds near 0 and near pi; at pi either sign of the rotation is right, and one is given. GeometryError for a
        pose that is not finite.

        >>> Pose.exp(np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])).log().round(9)
        array([1. , 2. , 3. , 0.1, 0.2, 0.3])
        """
        phi = log_so3(self.rotation)
        return np.concatenate([right_jacobian_inverse(-phi) @ _vector("a translation", self.translation, 3), phi])

    def adjoint(self) -> Floats:
        """Ad (6, 6), over (translation, rotation): self @ Pose.exp(x) equals Pose.exp(Ad @ x) @ self.

        >>> moved = Pose(np.eye(3), np.array([0.0, 0.0, 2.0]))
        >>> moved.adjoint() @ np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
        array([0., 2., 0., 1., 0., 0.])
        """
        out = np.zeros((6, 6))
        out[:3, :3] = out[3:, 3:] = self.rotation
        out[:3, 3:] = cross_matrix(self.translation) @ self.rotation
        return out

    def retract(self, step: Floats) -> Pose:
        """Move by a right perturbation (6,) of translation rho, metres, and rotation phi, radians.

        The result is (R exp(phi), t + R rho): rotation and translation are moved apart. This is the perturbation of
        every derivative and covariance of the package. `self @ Pose.exp(step)` is (R exp(phi), t + R V(phi) rho); both
        agree to first order, and wherever rho or phi is 0. GeometryError for a rotation that is not finite.

        >>> Pose.identity().retract(np.array([1.0, 0.0, 0.0, 0.0, 0.0, np.pi / 2])).translation
        array([1., 0., 0.])
        """
        return Pose(self.rotation @ exp_so3(step[3:]), self.translation + self.rotation @ step[:3])

    def local(self, other: Pose) -> Floats:
        """The step (6,) with which `retract` moves this pose to another: translation, metres, then rotation, radians.

        Its rotation is of at most pi. GeometryError for a rotation that is not finite.

        >>> Pose.identity().local(Pose.from_yaw(0.5, np.array([1.0, 2.0, 3.0]))).round(9)
        array([1. , 2. , 3. , 0. , 0. , 0.5])
        """
        rho = self.rotation.T @ (other.translation - self.translation)
        return np.concatenate([rho, log_so3(self.rotation.T @ other.rotation)])

    def interpolate(self, other: Pose, share: float) -> Pose:
        """The pose at a share of the way to another: 0 is this pose, 1 the other.

        The translation goes along a straight line. The rotation goes the short way about a fixed axis, at a constant
        rate (slerp, Shoemake 1985). Below 0 and above 1 both are carried on. GeometryError for a rotation or a share
        that is not finite.

        >>> half = Pose.identity().interpolate(Pose.from_yaw(1.0, np.array([4.0, 0.0, 0.0])), 0.5)
        >>> round(half.yaw_rad, 9), half.translation
        (0.5, array([2., 0., 0.]))
        """
        turn = exp_so3(share * log_so3(self.rotation.T @ other.rotation))
        return Pose(self.rotation @ turn, (1.0 - share) * self.translation + share * other.translation)

    def to_quaternion(self, *, order: QuaternionOrder) -> Floats:
        """The rotation as a unit quaternion (4,) whose real part w is not negative; `order` says where w stands.

        GeometryError for another order.

        >>> Pose.identity().to_quaternion(order="wxyz")
        array([1., 0., 0., 0.])
        """
        xyzw = quaternions_of_rotations(self.rotation[None])[0]
        return np.asarray(xyzw if _real_part_is_last(order) else np.roll(xyzw, 1), float)

    @property
    def matrix(self) -> Floats:
        """The (4, 4) homogeneous matrix."""
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = self.rotation, self.translation
        return m

    @property
    def yaw_rad(self) -> float:
        """Heading of the x axis about z, radians, from -pi to pi."""
        return float(np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))

    def inverse(self) -> Pose:
        """`b_from_a` of this `a_from_b`."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def transform(self, points: Floats) -> Floats:
        """Take points (..., 3), metres, from b to a."""
        moved: Floats = points @ self.rotation.T + self.translation
        return moved


def nearest_rotation(matrix: Floats) -> Floats:
    """Return the rotation (3, 3) nearest to a matrix (3, 3) in the Frobenius norm (Kabsch 1976).

    A matrix that is a rotation but for rounding is returned as it is, so that what is written and read stays the same.

    >>> nearest_rotation(np.diag([2.0, 3.0, 4.0]))
    array([[1., 0., 0.],
           [0., 1., 0.],
           [0., 0., 1.]])
    """
    if np.abs(matrix @ matrix.T - np.eye(3)).max() < _ROUNDING and np.linalg.det(matrix) > 0:
        return np.array(matrix, float)
    u, _, vt = np.linalg.svd(matrix)
    nearest: Floats = u @ np.diag([1.0, 1.0, float(np.sign(np.linalg.det(u @ vt)))]) @ vt
    return nearest


def _vector(what: str, values: Floats, length: int) -> Floats:
    """Finite float64 of so many entries."""
    vector = np.asarray(values, float)
    if vector.shape != (length,) or not np.isfinite(vector).all():
        raise GeometryError(f"{what} is {length} finite numbers, found shape {vector.shape}: {vector.tolist()}")
    return vector


def _real_part_is_last(order: QuaternionOrder) -> bool:
    if order not in ("xyzw", "wxyz"):
        raise GeometryError(f"a quaternion's order is xyzw or wxyz, found {order!r}")
    return order == "xyzw"
