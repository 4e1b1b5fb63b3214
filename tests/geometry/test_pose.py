"""Laws of SE(3), over random poses, poses near the identity and half turns."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation, Slerp

from meshslam.errors import GeometryError
from meshslam.geometry import (
    Pose,
    cross_matrix,
    exp_so3,
    hat,
    log_so3,
    nearest_rotation,
    right_jacobian,
    right_jacobian_inverse,
)

ANGLES = [0.0, 1e-14, 1e-9, 1e-6, 0.99e-4, 1.01e-4, 1e-3, 0.1, 1.0, 3.0, np.pi - 1e-4, np.pi - 1e-7, np.pi - 1e-10]
PAIRS = list(zip(ANGLES, np.roll(ANGLES, 5), strict=True))


def _tangents(angle, count=5):
    """Tangent vectors (translation, rotation) whose rotation is by an angle."""
    random = np.random.default_rng(int(1e6 * angle))
    axes = random.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return np.hstack([random.normal(size=(count, 3)) * 3.0, angle * axes])


def _poses(angle):
    return [Pose(exp_so3(x[3:]), x[:3]) for x in _tangents(angle)]


def _same(a, b, atol=1e-12):
    np.testing.assert_allclose(a.rotation, b.rotation, rtol=0, atol=atol)
    np.testing.assert_allclose(a.translation, b.translation, rtol=0, atol=atol)


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_poses_are_a_group(first, second):
    for a, b, c in zip(_poses(first), _poses(second), _poses(1.3), strict=True):
        _same((a @ b) @ c, a @ (b @ c))
        _same(a @ Pose.identity(), a)
        _same(Pose.identity() @ a, a)
        _same(a @ a.inverse(), Pose.identity())
        _same((a @ b).inverse(), b.inverse() @ a.inverse())
        np.testing.assert_allclose((a @ b).matrix, a.matrix @ b.matrix, atol=1e-12)
        np.testing.assert_allclose((a @ b).transform(c.rotation), a.transform(b.transform(c.rotation)), atol=1e-12)


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_is_the_exponential_of_the_matrix(angle):
    for x in _tangents(angle):
        generator = np.zeros((4, 4))
        generator[:3, :3], generator[:3, 3] = hat(x[3:]), x[:3]
        found = Pose.exp(x)
        np.testing.assert_allclose(found.matrix, expm(generator), rtol=0, atol=1e-12)
        np.testing.assert_allclose(found.rotation, Rotation.from_rotvec(x[3:]).as_matrix(), rtol=0, atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_log_is_the_inverse_of_exp(angle):
    for x in _tangents(angle):
        np.testing.assert_allclose(Pose.exp(x).log(), x, rtol=0, atol=1e-8 if angle > 3.1 else 1e-11)
        _same(Pose.exp(Pose.exp(x).log()), Pose.exp(x))
    for pose in _poses(angle):
        _same(Pose.exp(pose.log()), pose)


def test_exp_of_a_tiny_motion_keeps_its_digits():
    x = np.array([1e-9, -2e-9, 3e-9, 2e-9, 1e-9, -1e-9])
    np.testing.assert_allclose(Pose.exp(x).log(), x, rtol=1e-12)


def test_log_of_half_turns_is_a_half_turn():
    for axis in [*np.eye(3), *_tangents(1.0)[:, 3:]]:
        half_turn = Pose(2.0 * np.outer(axis, axis) - np.eye(3), np.array([1.0, -2.0, 0.5]))
        assert np.linalg.norm(half_turn.log()[3:]) == pytest.approx(np.pi, abs=1e-12)
        _same(Pose.exp(half_turn.log()), half_turn)


@pytest.mark.parametrize("angle", ANGLES)
def test_one_motion_done_in_parts_is_the_whole(angle):
    for x in _tangents(angle):
        _same(Pose.exp(0.3 * x) @ Pose.exp(0.7 * x), Pose.exp(x))
        _same(Pose.exp(x).inverse(), Pose.exp(-x))


@pytest.mark.parametrize("angle", ANGLES)
def test_the_inverse_of_the_jacobian_is_its_inverse(angle):
    for x in _tangents(angle):
        product = right_jacobian(x[3:]) @ right_jacobian_inverse(x[3:])
        np.testing.assert_allclose(product, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_adjoint_carries_a_perturbation_to_the_other_side(first, second):
    for pose, x in zip(_poses(first), _tangents(second), strict=True):
        _same(pose @ Pose.exp(x), Pose.exp(pose.adjoint() @ x) @ pose, atol=1e-10)
    for a, b in zip(_poses(first), _poses(second), strict=True):
        np.testing.assert_allclose((a @ b).adjoint(), a.adjoint() @ b.adjoint(), atol=1e-11)
        np.testing.assert_allclose(a.inverse().adjoint() @ a.adjoint(), np.eye(6), atol=1e-11)


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_local_is_the_inverse_of_retract(first, second):
    for pose, other, step in zip(_poses(first), _poses(second), _tangents(second), strict=True):
        np.testing.assert_allclose(pose.local(pose.retract(step)), step, rtol=0, atol=1e-7 if second > 3.1 else 1e-11)
        _same(pose.retract(pose.local(other)), other)


def test_retract_moves_as_exp_to_first_order_and_where_one_part_is_zero():
    for pose, x in zip(_poses(1.2), _tangents(1.0), strict=True):
        small = 1e-6 * x
        _same(pose.retract(small), pose @ Pose.exp(small), atol=1e-11)
        for part in (slice(3), slice(3, 6)):
            alone = np.zeros(6)
            alone[part] = x[part]
            _same(pose.retract(alone), pose @ Pose.exp(alone))
        assert np.abs(pose.retract(x).translation - (pose @ Pose.exp(x)).translation).max() > 0.01


@pytest.mark.parametrize("angle", ANGLES)
def test_retract_and_adjoint_are_their_formulas_to_the_bit(angle):
    for pose, step in zip(_poses(1.1), _tangents(angle), strict=True):
        moved = Pose(pose.rotation @ exp_so3(step[3:]), pose.translation + pose.rotation @ step[:3])
        np.testing.assert_array_equal(pose.retract(step).matrix, moved.matrix)
        blocks = [[pose.rotation, hat(pose.translation) @ pose.rotation], [np.zeros((3, 3)), pose.rotation]]
        np.testing.assert_array_equal(pose.adjoint(), np.block(blocks))
        np.testing.assert_array_equal(cross_matrix(step[:3]), hat(step[:3]))


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_interpolation_ends_at_both_poses(first, second):
    for a, b in zip(_poses(first), _poses(second), strict=True):
        start, end = a.interpolate(b, 0.0), a.interpolate(b, 1.0)
        np.testing.assert_array_equal(start.translation, a.translation)
        np.testing.assert_array_equal(end.translation, b.translation)
        _same(start, a)
        _same(end, b)


@pytest.mark.parametrize("angle", ANGLES)
def test_interpolation_goes_at_a_constant_rate(angle):
    for a, turn in zip(_poses(1.0), _poses(angle), strict=True):
        b = a @ turn
        slerp = Slerp([0.0, 1.0], Rotation.from_matrix([a.rotation, b.rotation]))
        whole = log_so3(a.rotation.T @ b.rotation)
        for share in (0.1, 0.25, 0.5, 0.9):
            found = a.interpolate(b, share)
            np.testing.assert_allclose(found.rotation, slerp(share).as_matrix(), atol=1e-9)
            np.testing.assert_allclose(log_so3(a.rotation.T @ found.rotation), share * whole, atol=1e-9)
            np.testing.assert_allclose(found.translation, a.translation + share * (b.translation - a.translation))


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
@pytest.mark.parametrize("angle", ANGLES)
def test_quaternions_are_those_of_scipy(angle, order):
    first = np.array([0, 1, 2, 3]) if order == "xyzw" else np.array([3, 0, 1, 2])
    for pose in _poses(angle):
        expected = Rotation.from_matrix(pose.rotation).as_quat(canonical=True)[first]
        found = pose.to_quaternion(order=order)
        np.testing.assert_array_equal(found, expected)
        assert np.linalg.norm(found) == pytest.approx(1.0)
        for scale in (1.0, -1.0, 7.0, 1e-50):
            _same(Pose.from_quaternion(scale * found, pose.translation, order=order), pose)


@pytest.mark.parametrize(
    "quaternion", [[0, 0, 0, 0], [1e-180, 0, 0, 0], [1e150, 0, 0, 1], [0, 0, np.nan, 1], [0, 0, np.inf, 1], [0, 0, 1]]
)
def test_what_is_no_quaternion_is_refused(quaternion):
    with pytest.raises(GeometryError, match="quaternion"):
        Pose.from_quaternion(np.array(quaternion, float), np.zeros(3), order="xyzw")


def test_an_order_of_quaternions_must_be_named():
    with pytest.raises(TypeError, match="order"):
        Pose.identity().to_quaternion()
    with pytest.raises(TypeError, match="order"):
        Pose.from_quaternion(np.array([0.0, 0, 0, 1]), np.zeros(3))
    with pytest.raises(GeometryError, match="xyzw or wxyz, found 'zyxw'"):
        Pose.identity().to_quaternion(order="zyxw")
    with pytest.raises(GeometryError, match="xyzw or wxyz, found 'zyxw'"):
        Pose.from_quaternion(np.array([0.0, 0, 0, 1]), np.zeros(3), order="zyxw")


def test_what_is_not_finite_is_refused():
    nan, pose = np.array([0, 0, np.nan]), Pose.identity()
    broken = Pose(np.full((3, 3), np.nan), np.zeros(3))
    for call in (
        lambda: Pose.exp(np.full(6, np.nan)),
        lambda: Pose.exp(np.zeros(5)),
        lambda: Pose.from_quaternion(np.array([0.0, 0, 0, 1]), nan, order="xyzw"),
        lambda: Pose(np.eye(3), nan).log(),
        broken.log,
        lambda: pose.retract(np.full(6, np.nan)),
        lambda: pose.local(broken),
        lambda: pose.interpolate(broken, 0.5),
        lambda: pose.interpolate(pose, np.nan),
    ):
        with pytest.raises(GeometryError):
            call()


def test_a_rotation_but_for_rounding_is_its_own_nearest(rng):
    for matrix in Rotation.random(50, random_state=rng).as_matrix():
        np.testing.assert_array_equal(nearest_rotation(matrix), matrix)
        assert np.abs(nearest_rotation(matrix + 1e-9) - matrix).max() > 0
        np.testing.assert_allclose(np.linalg.det(nearest_rotation(-matrix)), 1.0)


def test_a_pose_is_restored_from_its_matrix_to_the_last_bit(rng):
    for _ in range(50):
        turn = exp_so3(rng.normal(size=3)) + rng.normal(0, 1e-12, (3, 3))  # as rounding leaves it
        pose = Pose(turn, rng.normal(size=3))
        assert np.array_equal(Pose.restored(pose.matrix).matrix, pose.matrix)
    with pytest.raises(GeometryError):
        Pose.restored(2.0 * np.eye(4))
