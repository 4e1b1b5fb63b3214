"""What each simple factor says: where its cost is zero, and how it grows from there."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, E, O, S, V, X, Z

from meshslam.geometry import Pose, exp_so3
from meshslam.graph.displacement_factor import displacement_factor
from meshslam.graph.road_factor import road_factor
from meshslam.graph.window import linear_factor, rows_factor
from meshslam.motion import to_pose3

SEEDS = pytest.mark.parametrize("seed", range(4))


def random_pose(rng):
    return Pose(exp_so3(rng.normal(0, 1.5, 3)), rng.normal(0, 30, 3))


def values_of(**variables):
    values = gtsam.Values()
    for key, value in variables.items():
        values.insert(KEYS[key], value)
    return values


KEYS = {"one": X(1), "other": X(2), "thing": O(5), "z": Z(1), "s": S(0)}


@SEEDS
def test_rows_say_where_the_step_from_their_values_ends(seed):
    """|A x - b| is zero at x = A^-1 b, and half its square everywhere else."""
    rng = np.random.default_rng(seed)
    values = gtsam.Values()
    values.insert(X(1), to_pose3(random_pose(rng)))
    values.insert(V(1), rng.normal(size=3))
    values.insert(B(1), gtsam.imuBias.ConstantBias(rng.normal(size=3), rng.normal(size=3)))
    values.insert(E(0), gtsam.Rot3(exp_so3(rng.normal(size=3))))
    keys = [(E(0), 3), (V(1), 3), (X(1), 6), (B(1), 6)]
    matrix, step = rng.normal(size=(18, 18)), rng.normal(0, 0.3, 18)
    factor = rows_factor(keys, np.column_stack([matrix, matrix @ step]), values)

    def at(x):
        delta, start = gtsam.VectorValues(), 0
        for key, width in keys:
            delta.insert(key, x[start : start + width])
            start += width
        return factor.error(values.retract(delta))

    assert at(step) == pytest.approx(0, abs=1e-12)
    elsewhere = rng.normal(0, 0.3, 18)
    assert at(elsewhere) == pytest.approx(0.5 * np.sum((matrix @ (elsewhere - step)) ** 2))


@SEEDS
def test_a_linear_factor_is_the_sum_of_both_parts_in_sigmas(seed):
    rng = np.random.default_rng(seed)
    one, other, z, s = rng.normal(size=(5, 4)), rng.normal(size=(5, 1)), rng.normal(size=4), rng.normal(size=1)
    factor = linear_factor(Z(1), one, S(0), other, 0.3)
    assert factor.error(values_of(z=z, s=s)) == pytest.approx(0.5 * np.sum(((one @ z + other @ s) / 0.3) ** 2))


@SEEDS
def test_a_displacement_is_the_distance_of_the_cameras_not_of_the_imus(seed):
    rng = np.random.default_rng(seed)
    one, other, arm = random_pose(rng), random_pose(rng), rng.normal(0, 2, 3)
    distance_m = float(np.linalg.norm(one.transform(arm) - other.transform(arm)))
    values = values_of(one=to_pose3(one), other=to_pose3(other))
    errors = [displacement_factor([X(1), X(2)], arm, distance_m + off, 0.02).error(values) for off in (0.0, 0.002, 2.0)]
    assert errors[0] == pytest.approx(0, abs=1e-12)
    assert errors[1] == pytest.approx(0.5 * 0.1**2, rel=1e-3)
    assert errors[2] == pytest.approx(0.5 * 6.0**2 * np.log1p((100.0 / 6.0) ** 2))  # Cauchy's kernel of 6 sigmas


@SEEDS
def test_an_object_lies_as_far_below_the_camera_as_it_is_told(seed):
    rng = np.random.default_rng(seed)
    imu, arm, turn = random_pose(rng), rng.normal(0, 2, 3), random_pose(rng).rotation
    below = imu.transform(arm) - np.array([7.0, -3.0, 1.4])
    values = values_of(one=to_pose3(imu), thing=to_pose3(Pose(turn, below)))
    errors = [road_factor(X(1), O(5), arm, height_m, 0.1).error(values) for height_m in (1.4, 1.6)]
    assert errors == pytest.approx([0, 0.5 * 2.0**2], abs=1e-9)
