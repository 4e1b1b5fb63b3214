import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshslam.errors import GeometryError
from meshslam.geometry import quaternions_of_rotations, rotations_of_quaternions


@pytest.fixture
def quaternions(rng):
    """Random ones, and those with zeros, with equal entries, and short or long ones."""
    found = rng.normal(size=(4000, 4))
    found[:500] *= rng.choice([1e-8, 1e8], (500, 1))
    found[500:1000, 3] = 0
    found[1000:1500, :2] = 0
    found[1500:2500] = np.round(found[1500:2500])
    found[(found == 0).all(axis=1)] = [0, 0, 0, -1]
    return found


def test_matrices_are_those_of_scipy(quaternions):
    found = rotations_of_quaternions(quaternions)
    np.testing.assert_array_equal(found, Rotation.from_quat(quaternions).as_matrix())
    np.testing.assert_allclose(found @ found.transpose(0, 2, 1), np.broadcast_to(np.eye(3), found.shape), atol=1e-14)


@pytest.mark.parametrize("noise", [0.0, 1e-14, 1e-9, 1e-4])
def test_quaternions_are_those_of_scipy(quaternions, rng, noise):
    matrices = Rotation.from_quat(quaternions).as_matrix()
    matrices += noise * rng.normal(size=matrices.shape)
    found = quaternions_of_rotations(matrices)
    np.testing.assert_allclose(found, Rotation.from_matrix(matrices).as_quat(canonical=True), rtol=0, atol=1e-15)
    assert (found[:, 3] >= 0).all()
    if not noise:
        np.testing.assert_allclose(rotations_of_quaternions(found), matrices, atol=1e-14)


@pytest.mark.parametrize("matrix", [np.diag([1.0, 1.0, -1.0]), np.zeros((3, 3)), np.full((3, 3), np.nan)])
def test_what_is_no_rotation_is_refused(matrix):
    with pytest.raises(GeometryError, match="determinant"):
        quaternions_of_rotations(np.stack([np.eye(3), matrix]))


def test_a_quaternion_without_length_is_refused():
    with pytest.raises(GeometryError, match="length 0"):
        rotations_of_quaternions(np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]]))


def test_none_give_none():
    assert rotations_of_quaternions(np.zeros((0, 4))).shape == (0, 3, 3)
    assert quaternions_of_rotations(np.zeros((0, 3, 3))).shape == (0, 4)
