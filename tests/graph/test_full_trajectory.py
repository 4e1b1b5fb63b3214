"""A loop without masks: odometry that drifts, objects seen twice, all smoothed together."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import O, X, Z

from meshslam.graph.full_trajectory import History, smooth_full_trajectory
from meshslam.graph.window import Window

STEPS, TURN_RAD, WAY_M = 40, 2 * np.pi / 32, 2.0  # a circle and a quarter of the next
ODOMETRY = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.01] * 3 + [0.05] * 3))
SIGHT = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.01] * 3 + [0.03] * 3))


def pose(turn_rad, x, y=0.0):
    return gtsam.Pose3(gtsam.Rot3.Yaw(turn_rad), np.array([x, y, 0.0]))


def truth():
    poses = [gtsam.Pose3()]
    for _ in range(STEPS):
        poses.append(poses[-1].compose(pose(TURN_RAD, WAY_M)))
    return poses


def run(rng):
    """Past, window, and the pairs of objects that are one: each frame sees one object, and each lap names it anew."""
    history, window, true = History(), Window(), truth()
    window.values.insert(X(0), true[0])
    window.add(gtsam.PriorFactorPose3(X(0), true[0], gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)))
    drifted = [true[0]]
    for i in range(STEPS):
        step = pose(1.02 * TURN_RAD + rng.normal(0, 0.005), 0.97 * WAY_M + rng.normal(0, 0.02))
        drifted.append(drifted[-1].compose(step))
        window.values.insert(X(i + 1), drifted[-1])
        window.add(gtsam.BetweenFactorPose3(X(i), X(i + 1), step, ODOMETRY))
        side = pose(0.1, 3.0, 4.0)  # of the camera
        window.values.insert(O(i), drifted[i].compose(side))
        window.values.insert(Z(i), np.zeros(2))
        window.add(gtsam.PriorFactorVector(Z(i), np.zeros(2), gtsam.noiseModel.Unit.Create(2)))
        window.add(gtsam.BetweenFactorPose3(X(i), O(i), side, SIGHT))
        if i > 5:
            history.take(window, {X(i - 5), O(i - 5), Z(i - 5)} | ({X(0), O(0), Z(0)} if i == 6 else set()))
    return history, window, [(i, i - 32) for i in range(32, STEPS)]


def smoothed(*given):
    everything, held = smooth_full_trajectory(*given)
    return everything.values, held


def error_m(values):
    places = [values.atPose3(X(i)).translation() for i in range(STEPS + 1)]
    return np.linalg.norm(np.array(places) - [p.translation() for p in truth()], axis=1)


@pytest.mark.parametrize("seed", range(3))
def test_a_loop_is_closed(seed):
    history, window, joined = run(np.random.default_rng(seed))
    alone, _ = smoothed(history, window, [], 10)
    closed, held = smoothed(history, window, joined, 10)
    assert held == tuple(joined)
    assert error_m(closed)[-1] < 0.5 * error_m(alone)[-1]
    gaps = [closed.atPose3(O(a)).translation() - closed.atPose3(O(b)).translation() for a, b in joined]
    assert np.linalg.norm(gaps, axis=1).max() < 0.1


def test_a_wrong_pair_is_taken_back():
    history, window, joined = run(np.random.default_rng(0))
    right, _ = smoothed(history, window, joined, 10)
    found, held = smoothed(history, window, [*joined, (20, 4)], 10)
    assert held == tuple(joined)
    assert np.abs(error_m(found) - error_m(right)).max() < 0.05


def test_without_pairs_nothing_that_left_is_lost():
    history, window, _ = run(np.random.default_rng(1))
    values, _ = smoothed(history, window, [], 10)
    assert values.size() == history.values.size() + window.values.size() == 3 * STEPS + 1
    assert np.allclose(values.atPose3(X(STEPS)).matrix(), window.values.atPose3(X(STEPS)).matrix(), atol=1e-3)


def test_pairs_that_are_found_on_the_way_count_as_if_they_had_been_given():
    history, window, joined = run(np.random.default_rng(2))
    asked = []

    def find(places, held):
        asked.append((len(places), tuple(held)))
        return joined[3:]

    given, _ = smoothed(history, window, joined, 10)
    found, held = smoothed(history, window, joined[:3], 10, find)
    assert asked == [(STEPS, tuple(joined[:3]))]
    assert held == tuple(joined)
    assert np.abs(error_m(found) - error_m(given)).max() < 1e-3
