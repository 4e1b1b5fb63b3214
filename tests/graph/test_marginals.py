"""Joint covariances by one elimination are blocks of the whole graph's inverse."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import E, T, V, X

from meshslam.geometry import BlockSystem, Pose, exp_so3
from meshslam.graph.camera_covariance import camera_covariance, path_covariances
from meshslam.graph.marginals import joint_covariances
from meshslam.graph.object_factor import place_camera
from meshslam.graph.window import Window
from meshslam.motion import to_pose3

COUNT = 12
WIDTHS = {E(0): 3, T(0): 1} | {X(i): 6 for i in range(COUNT)} | {V(i): 3 for i in range(COUNT)}


def block(rng, rows, key):
    return key, rng.normal(size=(rows, WIDTHS[key]))


def whitened(rows):
    return gtsam.noiseModel.Unit.Create(rows)


def chain(rng):
    """A path whose frames are tied to the next, and a few of them to what all share."""
    graph = gtsam.GaussianFactorGraph()
    graph.push_back(
        gtsam.JacobianFactor(*block(rng, 12, X(0)), *block(rng, 12, V(0)), rng.normal(size=12), whitened(12))
    )
    graph.push_back(gtsam.JacobianFactor(*block(rng, 6, E(0)), *block(rng, 6, T(0)), rng.normal(size=6), whitened(6)))
    for i in range(1, COUNT):
        for one, other in ((X(i - 1), X(i)), (V(i - 1), V(i)), (V(i - 1), X(i))):
            graph.push_back(
                gtsam.JacobianFactor(*block(rng, 7, one), *block(rng, 7, other), rng.normal(size=7), whitened(7))
            )
        if i % 4 == 1:
            graph.push_back(
                gtsam.JacobianFactor(
                    *block(rng, 5, X(i)), *block(rng, 5, E(0)), *block(rng, 5, T(0)), rng.normal(size=5), whitened(5)
                )
            )
    return graph


def inverse(graph):
    """The whole covariance, and where each variable is in it."""
    ordering, places, start = gtsam.Ordering(), {}, 0
    for key, width in WIDTHS.items():
        ordering.push_back(key)
        places[key] = np.arange(start, start + width)
        start += width
    jacobian = np.asarray(graph.augmentedJacobian(ordering))[:, :-1]
    return np.linalg.inv(jacobian.T @ jacobian), places


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("last", [(E(0), T(0)), (), tuple(WIDTHS)], ids=["shared", "none", "all"])
def test_every_group_is_a_block_of_the_inverse(seed, last):
    graph = chain(np.random.default_rng(seed))
    groups = [(X(i), V(i), E(0), T(0)) for i in range(COUNT)] + [(X(0), V(3), X(9))]
    whole, places = inverse(graph)
    for group, found in zip(groups, joint_covariances(graph, groups, WIDTHS, last), strict=True):
        at = np.concatenate([places[key] for key in group])
        expected = whole[np.ix_(at, at)]
        assert found == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(3))
def test_of_what_is_last_the_solution_holds_the_covariance_and_of_nothing_else(seed):
    graph = chain(np.random.default_rng(seed))
    newest = (X(COUNT - 1), V(COUNT - 1))
    system = BlockSystem(WIDTHS)
    for i in range(graph.size()):
        system.add_rows(graph.at(i).keys(), graph.at(i).augmentedJacobian())
    solution = system.solve(newest)
    whole, places = inverse(graph)
    at = np.concatenate([places[key] for key in newest])
    assert solution.covariance(newest) == pytest.approx(whole[np.ix_(at, at)], rel=1e-6, abs=1e-9)
    assert solution.covariance((X(0), V(0))) is None
    step = graph.optimize()
    expected = np.concatenate([step.at(key) for key in sorted(WIDTHS)])
    assert solution.step == pytest.approx(expected, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_core_finds_the_same_covariances_by_cholesky(seed):
    graph = chain(np.random.default_rng(seed))
    groups = [(X(i), V(i), E(0), T(0)) for i in range(COUNT)] + [(X(0), V(3), X(9))]
    for blocks in (None, [key & 0xFF_FFFF if key not in (E(0), T(0)) else key for key in WIDTHS]):
        system = BlockSystem(WIDTHS, blocks)
        for i in range(graph.size()):
            system.add_rows(graph.at(i).keys(), graph.at(i).augmentedJacobian())
        by_qr = joint_covariances(graph, groups, WIDTHS, (E(0), T(0)))
        for one, other in zip(system.covariances(groups, (E(0), T(0))), by_qr, strict=True):
            assert one == pytest.approx(other, abs=1e-8 * np.abs(other).max())


# --- cameras


def places_of(rng, count):
    """Cameras with their derivatives, the IMU driving ahead."""
    mounted = Pose(exp_so3(rng.normal(size=3)), np.array([1.0, 0.2, 0.7]))
    return [
        place_camera(
            Pose(exp_so3(rng.normal(0, 0.2, 3)), np.array([2.0 * i, 0.0, 0.0])),
            np.array([20.0, 0.0, 0.0]) + rng.normal(size=3),
            mounted,
            0.01,
            rng.normal(0, 0.2, 3),
        )
        for i in range(count)
    ]


@pytest.fixture
def solved():
    """A window with the linear chain, as `optimize` leaves it, and its cameras."""
    rng = np.random.default_rng(5)
    window, places = Window(), places_of(rng, COUNT)
    for key, width in WIDTHS.items():
        if width == 6:
            window.values.insert(key, to_pose3(Pose.identity()))
        elif key == E(0):
            window.values.insert(key, gtsam.Rot3())
        else:
            window.values.insert(key, np.zeros(width))
    linear = chain(rng)
    for i in range(linear.size()):
        window.add(gtsam.LinearContainerFactor(linear.at(i), window.values))
    return window, places, [(X(i), V(i), E(0), T(0)) for i in range(COUNT)]


def test_a_path_in_a_given_world_has_each_cameras_own_covariance(solved):
    window, places, keys = solved
    found = path_covariances(window, places, keys)
    joint = window.joint_covariances(keys, keys[0][2:])
    for place, covariance, own in zip(places, found, joint, strict=True):
        assert covariance == pytest.approx(camera_covariance(place, own))
        assert np.linalg.eigvalsh(covariance).min() > 0


def test_relative_to_the_first_camera_the_first_is_certain_and_the_others_are_as_drawn(solved):
    """Against draws of all variables, each moved path being laid anew by its own first pose."""
    window, places, keys = solved
    known = Pose(exp_so3(np.array([0.1, -0.2, 0.5])), np.array([3.0, 4.0, 5.0]))
    laid = path_covariances(window, places, keys, lambda first: known @ first.inverse())
    assert np.abs(laid[0]).max() < 1e-9 * np.abs(laid[-1]).max()
    whole, where = inverse(window.linearized())
    small = 1e-8  # so that what is linear is all there is
    steps = np.random.default_rng(1).multivariate_normal(np.zeros(len(whole)), small * whole, 20000)

    def moved(index):
        place = places[index]
        columns = np.hstack(
            [place.by_imu[:, [3, 4, 5, 0, 1, 2]], place.by_velocity, place.by_rotation, place.by_offset]
        )
        at = np.concatenate([where[key] for key in keys[index]])
        return [place.pose.retract(columns @ step[at]) for step in steps[:2000]]

    mean = known @ places[0].pose.inverse() @ places[7].pose
    errors = np.array([mean.local(known @ a.inverse() @ b) for a, b in zip(moved(0), moved(7), strict=True)])
    drawn = errors.T @ errors / len(errors) / small
    scale = np.sqrt(np.outer(np.diag(drawn), np.diag(drawn)))
    assert (np.abs(drawn - laid[7]) < 0.1 * scale).all()


def test_a_world_that_no_pose_decides_changes_nothing(solved):
    window, places, keys = solved
    there = Pose(exp_so3(np.array([0.0, 0.0, 1.0])), np.array([3.0, 4.0, 5.0]))
    assert path_covariances(window, places, keys, lambda _: there) == pytest.approx(
        path_covariances(window, places, keys)
    )
