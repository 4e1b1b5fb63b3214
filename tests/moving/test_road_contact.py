"""Wheels on the road: residuals, derivatives, and how errors of the road's height add up."""

import numpy as np
import pytest

from meshslam.geometry import GroundPlane, Pose
from meshslam.moving.path_state import NODE_WIDTH, PathState
from meshslam.moving.road_contact import Contacts, RoadContact


@pytest.fixture
def contacts(car):
    return Contacts.of(car)


def state_on(planes, contacts, rng, modes):
    poses = [Pose.from_yaw(0.3, np.array([2.0 * i, 0.5 * i, 0.8])).retract(rng.normal(0, 0.03, 6)) for i in range(4)]
    return PathState.of(tuple(poses), np.full(4, 5.0), np.zeros(4), rng.normal(0, 1, modes))


def road(contacts, state, correlation_m=10.0):
    up = np.array([0.02, -0.01, 1.0])
    plane = GroundPlane(up / np.linalg.norm(up), 0.05, 0.1, 0.03)
    return RoadContact.below(contacts, [plane] * len(state), state, correlation_m)


def test_derivatives_are_those_of_differences(car, contacts, rng):
    state = state_on(None, contacts, rng, len(car.modes))
    contact = road(contacts, state)
    own, before, modes = contact.jacobians(state)
    count, step = len(state), 1e-6
    for k in range(count * NODE_WIDTH + len(car.modes)):
        moved = np.zeros(count * NODE_WIDTH + len(car.modes))
        moved[k] = step
        ahead, behind = (contact.residuals(state.retract(sign * moved)) for sign in (1, -1))
        found, expected = (ahead - behind) / (2 * step), np.zeros((count, 3))
        node, column = divmod(k, NODE_WIDTH)
        if node < count:
            expected[node] = own[node, :, column]
            if node + 1 < count:
                expected[node + 1] = before[node + 1, :, column]
        else:
            expected = modes[:, :, k - count * NODE_WIDTH]
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)


def test_a_mesh_on_the_plane_leaves_no_height(car, contacts):
    lowest = car.vertices[car.wheel_vertices].mean(0)[2]
    state = PathState.of((Pose.from_yaw(1.0, np.array([5.0, 3.0, -lowest])),), np.ones(1), np.zeros(1), np.zeros(20))
    plane = GroundPlane(np.array([0.0, 0.0, 1.0]), 0.0, 0.1, 0.03)
    assert abs(RoadContact.below(contacts, [plane], state, 10.0).residuals(state)[0, 0]) < 1e-9


def test_many_poses_near_each_other_tell_no_more_of_the_roads_height_than_one(car, contacts, rng):
    """The information of a common height: one observation's at one place, n of them far apart."""
    poses = [Pose.from_yaw(0.0, np.array([0.01 * i, 0.0, 0.8])) for i in range(40)]
    near = PathState.of(tuple(poses), np.ones(40), np.zeros(40), np.zeros(20))
    far = PathState.of(tuple(Pose(p.rotation, p.translation * [2e4, 1, 1]) for p in poses), *rest(near))
    told = [common_height_information(road(contacts, state), state) for state in (near, far)]
    assert told[0] == pytest.approx(1 / 0.1**2, rel=0.05)
    assert told[1] == pytest.approx(40 / 0.1**2, rel=0.05)


def rest(state):
    return state.speeds_m_s, state.curvatures, state.z


def common_height_information(contact, state):
    step = 1e-6
    raised = PathState(state.rotations, state.translations + [0.0, 0.0, step], *rest(state))
    by_height = (contact.residuals(raised) - contact.residuals(state))[:, 0] / step
    return float((by_height**2).sum())
