"""Covariances of objects along an uncertain path, against dense inverses and against the law of total covariance."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import E, O, T, V, X, Z

from meshslam.geometry import Pose
from meshslam.graph import moved_covariance
from meshslam.graph.object_covariance import object_covariances
from meshslam.graph.object_factor import place_camera
from meshslam.graph.window import Window
from meshslam.motion import from_pose3, to_gtsam_covariance

STEPS = 6
STEP_SIGMAS = np.array([0.01] * 3 + [0.05] * 3)
VIEW_SIGMAS = np.array([0.02] * 3 + [0.04] * 3)


def pose(yaw, *place):
    return gtsam.Pose3(gtsam.Rot3.Yaw(yaw), np.array(place, float))


def window_of(path_sigma=None):
    """A path of steps, objects seen from two of its cameras each; with `path_sigma` the path is known to that."""
    window = Window()
    window.values.insert(E(0), gtsam.Rot3())
    window.values.insert(T(0), np.zeros(1))
    window.values.insert(V(0), np.zeros(3))
    window.add(gtsam.PriorFactorRot3(E(0), gtsam.Rot3(), gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
    for key, width in ((T(0), 1), (V(0), 3)):
        window.add(gtsam.PriorFactorVector(key, np.zeros(width), gtsam.noiseModel.Isotropic.Sigma(width, 0.1)))
    at, step = pose(0.3, 1.0, 2.0, 1.5), pose(0.05, 1.0, 0.1, 0.0)
    for i in range(STEPS):
        window.values.insert(X(i), at)
        if i == 0:
            window.add(gtsam.PriorFactorPose3(X(0), at, gtsam.noiseModel.Diagonal.Sigmas(STEP_SIGMAS)))
        else:
            noise = gtsam.noiseModel.Diagonal.Sigmas(STEP_SIGMAS)
            window.add(gtsam.BetweenFactorPose3(X(i - 1), X(i), step, noise))
        if path_sigma is not None:
            window.add(gtsam.PriorFactorPose3(X(i), at, gtsam.noiseModel.Isotropic.Sigma(6, path_sigma)))
        at = at.compose(step)
    for number in range(STEPS - 1):
        side = pose(0.2, 2.0, 3.0, -0.5)
        window.values.insert(O(number), window.values.atPose3(X(number)).compose(side))
        window.values.insert(Z(number), np.zeros(2))
        window.add(gtsam.PriorFactorVector(Z(number), np.zeros(2), gtsam.noiseModel.Unit.Create(2)))
        for frame in (number, number + 1):
            seen = window.values.atPose3(X(frame)).between(window.values.atPose3(O(number)))
            noise = gtsam.noiseModel.Diagonal.Sigmas(VIEW_SIGMAS)
            window.add(gtsam.BetweenFactorPose3(X(frame), O(number), seen, noise))
    return window


def first_of(window):
    mounted, at = Pose.identity(), from_pose3(window.values.atPose3(X(0)))
    return place_camera(at, np.zeros(3), mounted, 0.0, np.zeros(3)), (X(0), V(0), E(0), T(0))


def test_the_whole_is_the_graphs_marginal():
    window = window_of()
    found = object_covariances(window, range(STEPS - 1), first_of(window))
    for number, one in found.items():
        dense = to_gtsam_covariance(window.covariance(O(number)))
        assert one.whole == pytest.approx(dense, rel=1e-5, abs=1e-10)


def test_what_the_path_does_not_make_is_left_where_the_path_is_known():
    window, known = window_of(), window_of(path_sigma=1e-5)
    found = object_covariances(window, range(STEPS - 1), first_of(window))
    for number, one in found.items():
        given_path = to_gtsam_covariance(known.covariance(O(number)))
        assert one.whole - one.by_path == pytest.approx(given_path, rel=1e-3, abs=1e-8)


def test_the_paths_part_grows_along_it_and_is_never_negative():
    window = window_of()
    found = object_covariances(window, range(STEPS - 1), first_of(window))
    traces = [np.trace(found[number].by_path[:3, :3]) for number in range(STEPS - 1)]
    assert np.all(np.diff(traces) > 0)
    assert all(np.linalg.eigvalsh(one.by_path).min() > -1e-12 for one in found.values())
    assert np.trace(object_covariances(window_of(1e-6), [3], first_of(window))[3].by_path) < 1e-6


def test_where_the_first_camera_lays_the_world_its_own_error_is_taken_out():
    """With W = C_0^-1 the first camera is exact; an object is as uncertain as its place relative to it."""
    window = window_of()
    place, keys = first_of(window)
    moved = object_covariances(window, [0, 4], (place, keys), lambda camera: camera.inverse())
    plain = object_covariances(window, [0, 4], (place, keys))
    rng = np.random.default_rng(0)
    joint = window.path_covariances([(X(0), O(4))], [X(0)])[0]
    steps = rng.multivariate_normal(np.zeros(12), joint, size=4000)
    order = [3, 4, 5, 0, 1, 2]
    camera, thing = (from_pose3(window.values.atPose3(key)) for key in (X(0), O(4)))
    relative = camera.inverse() @ thing
    errors = [relative.local(camera.retract(s[:6][order]).inverse() @ thing.retract(s[6:][order])) for s in steps]
    sampled = np.cov(np.array(errors).T)
    assert np.sqrt(np.diag(moved[4].whole)) == pytest.approx(np.sqrt(np.diag(sampled)), rel=0.08)
    assert np.trace(moved[0].whole) < np.trace(plain[0].whole)
    assert np.allclose(moved[4].world_from_object.matrix, relative.matrix)


@pytest.mark.parametrize("seed", range(5))
def test_a_covariance_moves_rigidly(seed):
    """Both poses move by one small motion of the world that they are fixed in."""
    rng = np.random.default_rng(seed)
    of, to = (Pose.from_yaw(rng.uniform(-3, 3), rng.normal(size=3)) for _ in range(2))
    root = rng.normal(size=(6, 6))
    steps = 1e-4 * root
    moved = []
    for step in steps.T:
        motion = of.retract(step) @ of.inverse()  # in the world
        moved.append(to.local(motion @ to))
    found = np.array(moved).T @ np.array(moved)
    assert found == pytest.approx(moved_covariance(steps @ steps.T, of, to), rel=1e-2, abs=1e-11)
