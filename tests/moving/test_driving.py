"""The constant-turn model: what it predicts, and its derivatives."""

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.moving import MovingConfig
from meshslam.moving.driving import Driving
from meshslam.moving.path_state import NODE_WIDTH, PathState

REAR_M = -1.3


def on_a_circle(speed, curvature, intervals):
    """Poses of a car whose rear axle drives an arc, by exact integration."""
    heading = np.concatenate([[0.4], 0.4 + np.cumsum(speed * curvature * intervals)])
    radius = 1 / curvature
    rear = radius * np.column_stack([np.sin(heading) - np.sin(0.4), np.cos(0.4) - np.cos(heading)])
    poses = []
    for (x, y), yaw in zip(rear, heading, strict=True):
        ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        poses.append(Pose.from_yaw(float(yaw), np.array([x, y, 0.7]) - REAR_M * ahead))
    count = len(poses)
    return PathState.of(tuple(poses), np.full(count, speed), np.full(count, curvature), np.zeros(2))


def random_state(rng, count):
    poses, place, yaw = [], np.zeros(3), 3.0  # beyond pi on the way
    for _ in range(count):
        yaw += rng.normal(0.1, 0.05)
        place = place + [np.cos(yaw), np.sin(yaw), 0.0] + rng.normal(0, 0.1, 3)
        poses.append(Pose.from_yaw(yaw, place).retract(rng.normal(0, 0.05, 6)))
    return PathState.of(tuple(poses), rng.normal(8, 2, count), rng.normal(0, 0.1, count), rng.normal(size=2))


@pytest.mark.parametrize(("speed", "curvature"), [(9.0, 1e-6), (5.0, 0.12), (-2.0, 0.15), (6.0, -0.1)])
def test_a_car_that_drives_an_arc_evenly_leaves_no_residual(rng, speed, curvature):
    intervals = rng.uniform(0.05, 0.3, 12)
    state = on_a_circle(speed, curvature, intervals)
    residuals = Driving(intervals, REAR_M, MovingConfig()).residuals(state)
    np.testing.assert_allclose(residuals, 0.0, atol=1e-6)


def test_a_car_pushed_sideways_and_one_that_turns_about_its_middle_do(rng):
    intervals = np.full(11, 0.1)
    driving, state = Driving(intervals, REAR_M, MovingConfig()), on_a_circle(5.0, 1e-9, intervals)
    left = state.rotations[0, :, 1]
    pushed = PathState(state.rotations, state.translations + np.outer(np.arange(12), 0.1 * left), *rest(state))
    assert np.abs(driving.residuals(pushed)[:, 1]).min() > 2
    turned = on_a_circle(5.0, 0.1, intervals)
    middle = Driving(intervals, 0.0, MovingConfig()).residuals(turned)  # as if the middle followed its heading
    assert np.abs(middle[:, 1]).min() > 1.5


def rest(state):
    return state.speeds_m_s, state.curvatures, state.z


@pytest.mark.parametrize("seed", range(3))
def test_its_derivatives_are_those_of_differences(seed):
    rng = np.random.default_rng(seed)
    state, driving = random_state(rng, 5), Driving(rng.uniform(0.05, 0.4, 4), REAR_M, MovingConfig())
    jacobians, step = driving.jacobians(state), 1e-6
    for i in range(4):
        for k in range(2 * NODE_WIDTH):
            moved = np.zeros(5 * NODE_WIDTH)
            moved[i * NODE_WIDTH + k] = step
            ahead, behind = (driving.residuals(state.retract(sign * moved))[i] for sign in (1, -1))
            np.testing.assert_allclose(jacobians[i, :, k], (ahead - behind) / (2 * step), rtol=1e-5, atol=1e-5)


def test_the_way_of_a_brownian_speed_has_the_variance_that_the_model_takes(rng):
    dt, runs, steps = 0.8, 4000, 400
    config = MovingConfig()
    speed = np.cumsum(rng.normal(0, config.acceleration * np.sqrt(dt / steps), (runs, steps)), axis=1)
    speed = np.concatenate([np.zeros((runs, 1)), speed], axis=1)
    way = 0.5 * (speed[:, 1:] + speed[:, :-1]).sum(1) * dt / steps
    left_over = way - 0.5 * speed[:, -1] * dt
    assert left_over.std() == pytest.approx(Driving(np.array([dt]), REAR_M, config).sigmas[0, 0], rel=0.05)
