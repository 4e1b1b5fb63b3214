"""A window's steps, and what is kept between them."""

from types import SimpleNamespace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import S, V, X, Z

from meshslam.geometry import Pose, exp_so3
from meshslam.graph import Smoother, SmootherConfig, StartConfig
from meshslam.graph.window import Window, linear_factor
from meshslam.motion import ImuConfig, Mounting, NavState, to_pose3


def two_vectors(weak, well=1e-7):
    """Two vectors, of which one factor knows the difference well, and another each of them weakly."""
    window, target = Window(), np.array([3.0, -2.0])
    for key in (Z(1), Z(2)):
        window.values.insert(key, np.zeros(2))
    window.add(linear_factor(Z(1), np.eye(2), Z(2), -np.eye(2), well))
    for key, sign in ((Z(1), 1.0), (Z(2), -1.0)):
        window.add(gtsam.PriorFactorVector(key, target + sign, gtsam.noiseModel.Isotropic.Sigma(2, weak)))
    return window, target


@pytest.mark.parametrize("weak", [1.0, 1e3], ids=["by Cholesky", "by QR, where precisions span 20 decades"])
def test_a_step_leads_to_the_best_values(weak):
    window, target = two_vectors(weak)
    window.optimize(3, 1e-12, [Z(1)])
    assert window.values.atVector(Z(1)) == pytest.approx(target, abs=1e-5)
    assert window.values.atVector(Z(2)) == pytest.approx(target, abs=1e-5)
    assert (window._solution is None) == (weak > 1.0)


def test_the_joint_covariance_is_the_same_however_it_is_found():
    window, _ = two_vectors(1.0, 1e-2)
    window.optimize(2, last=[Z(1), Z(2)])
    (kept,) = window.joint_covariances([(Z(2), Z(1))], [Z(1)])
    window.optimize(2)
    (found,) = window.joint_covariances([(Z(2), Z(1))], [Z(1)])
    assert kept == pytest.approx(found, rel=1e-6, abs=1e-9)


def test_what_is_left_behind_costs_the_same_in_the_core_and_in_gtsam(rng):
    window = Window()
    for number in range(3):
        window.values.insert(Z(number), rng.normal(size=2))
        window.values.insert(X(number), to_pose3(Pose(exp_so3(rng.normal(size=3)), rng.normal(size=3))))
        noise = gtsam.noiseModel.Isotropic.Sigma(6, 0.3)
        at = to_pose3(Pose(exp_so3(rng.normal(size=3)), rng.normal(size=3)))
        window.add(gtsam.PriorFactorPose3(X(number), at, noise))
        window.add(linear_factor(Z(number), rng.normal(size=(3, 2)), Z((number + 1) % 3), rng.normal(size=(3, 2))))
    for number in range(2):
        step = gtsam.Pose3(gtsam.Rot3(), np.array([1.0, 0.0, 0.0]))
        window.add(gtsam.BetweenFactorPose3(X(number), X(number + 1), step, noise))
    window.values.insert(S(0), np.zeros(1))
    window.add(linear_factor(S(0), np.ones((2, 1)), Z(0), np.eye(2)))
    window.marginalize({X(0), Z(0)})
    left = [entry for entry in window.entries if entry.origin is None]
    assert left
    assert all(entry.term is not None for entry in left)
    window.optimize(2)
    assert window.cost == pytest.approx(window._graph(window.entries).error(window.values), rel=1e-9)


def smoother():
    mounting = Mounting(Pose(np.eye(3), np.array([1.0, 0.2, 0.3])), 0.004)
    made = Smoother(ImuConfig(), StartConfig(), SmootherConfig(), mounting)
    zero = np.zeros(3)
    made.begin(NavState(0.0, Pose.identity(), np.array([5.0, 0.0, 0.0]), zero, zero), np.array([0.1, 0.2, 0.3]))
    return made


def test_an_estimate_follows_every_change_of_the_values():
    made = smoother()
    cameras = made.cameras

    def fresh():
        return cameras._estimate(0).world_from_camera.matrix

    assert cameras.estimate(0) is cameras.estimate(0)
    moved = Pose(exp_so3(np.array([0.0, 0.1, 0.0])), np.array([2.0, 0.0, 1.0]))
    cameras.place_of(0)
    cameras.place(moved)
    # the velocity, which stays, moves the camera within the time offset
    assert cameras.estimate(0).world_from_camera.matrix == pytest.approx(moved.matrix, abs=0.01)
    assert cameras.place_of(0).pose.matrix == pytest.approx(moved.matrix, abs=0.01)
    made.solve()
    assert cameras.estimate(0).world_from_camera.matrix == pytest.approx(fresh(), abs=0)
    assert cameras.place_of(0).pose.matrix == pytest.approx(fresh())
    assert not np.allclose(fresh(), moved.matrix, atol=0.1)


def test_a_checkpoint_brings_a_window_back(rng):
    made = smoother()
    window, cost = made.window, SimpleNamespace(evaluations=1)
    entry = window.add(gtsam.PriorFactorVector(V(0), np.ones(3), gtsam.noiseModel.Unit.Create(3)))
    entry.tag = SimpleNamespace(cost=cost)
    made.solve()
    entries, values, factor = window.entries, window.values, entry.factor
    before, count = made.estimate(0).state.velocity_in_world, len(entries)
    undo = window.checkpoint()
    window.settle([entry])
    window.values.update(V(0), np.full(3, 7.0))
    window.add(gtsam.PriorFactorVector(V(0), np.zeros(3), gtsam.noiseModel.Unit.Create(3)))
    cost.evaluations = 5
    made.solve()
    window.drop([entry])
    undo()
    assert window.entries is entries
    assert window.values is values
    assert len(entries) == count
    assert entry.factor is factor
    assert entry.term is None
    assert cost.evaluations == 1
    assert window.values.atVector(V(0)) == pytest.approx(before, abs=0)
