"""A camera a little after the window's newest frame: its mean and its covariance against what drawn states become."""

import numpy as np
import pytest

from meshslam.geometry import Pose, exp_so3
from meshslam.graph import CameraPrediction
from meshslam.motion import ImuConfig, Mounting, NavState, Preintegrator, predict
from meshslam.sequences import ImuSamples

MOUNTING = Mounting(
    Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([1.0, 0.1, 0.7])), 0.002
)
SIGMAS = np.repeat([0.002, 0.02, 0.1, 0.001, 0.0005], [3, 3, 3, 3, 1])  # X: rotation, translation; V; E; T


@pytest.fixture
def imu():
    times = np.arange(0.0, 1.0, 0.01)
    rates = np.column_stack([0.05 * np.sin(times), 0.02 * np.cos(times), 0.3 + 0.0 * times])
    forces = np.column_stack([0.5 + 0.0 * times, 1.0 + 0.2 * times, np.full(100, 9.81)])
    return ImuSamples(times, rates, forces)


@pytest.fixture
def state():
    pose = Pose(exp_so3(np.array([0.02, -0.01, 0.7])), np.array([3.0, 4.0, 1.0]))
    return NavState(0.3, pose, np.array([8.0, 3.0, 0.1]), np.array([0.05, 0.0, -0.02]), np.array([0.001, 0.002, 0.0]))


def test_it_is_where_the_preintegrated_samples_lead(imu, state):
    config = ImuConfig()
    found = CameraPrediction(state, MOUNTING, np.eye(13)).at(imu, 0.5, config)
    interval = Preintegrator(config).between(imu, 0.3, 0.5, state)
    rate = interval.angular_rate_rad_s - state.gyroscope_bias
    right = MOUNTING.world_from_camera(predict(state, interval, 0.5), rate)
    assert np.allclose(found.world_from_camera.matrix, right.matrix, atol=1e-12)
    assert not found.has_gap


def test_its_covariance_is_that_of_drawn_states(imu, state):
    config, rng = ImuConfig(), np.random.default_rng(0)
    found = CameraPrediction(state, MOUNTING, np.diag(SIGMAS**2)).at(imu, 0.5, config)
    drawn = []
    for _ in range(1500):
        x = SIGMAS * rng.normal(size=13)
        pose = state.world_from_imu @ Pose(exp_so3(x[:3]), x[3:6])
        moved = NavState(0.3, pose, state.velocity_in_world + x[6:9], state.accelerometer_bias, state.gyroscope_bias)
        turned = Pose(MOUNTING.imu_from_camera.rotation @ exp_so3(x[9:12]), MOUNTING.imu_from_camera.translation)
        mounting = Mounting(turned, MOUNTING.time_offset_s + x[12])
        other = CameraPrediction(moved, mounting, np.eye(13)).at(imu, 0.5, config)
        drawn.append(found.world_from_camera.local(other.world_from_camera))
    by_noise = CameraPrediction(state, MOUNTING, np.zeros((13, 13))).at(imu, 0.5, config).covariance
    right = np.cov(np.array(drawn).T) + by_noise
    scale = np.sqrt(np.diag(right))
    assert np.allclose(found.covariance / np.outer(scale, scale), right / np.outer(scale, scale), atol=0.12)
    assert found.covariance[0, 0] > 0.1**2 * 0.2**2  # the velocity's share has grown


def test_missing_samples_are_told_and_make_it_less_certain(imu, state):
    config, prediction = ImuConfig(), CameraPrediction(state, MOUNTING, np.diag(SIGMAS**2))
    few = ImuSamples(imu.times_s[:31], imu.angular_rate_rad_s[:31], imu.specific_force_m_s2[:31])
    whole, cut = prediction.at(imu, 0.9, config), prediction.at(few, 0.9, config)
    assert cut.has_gap
    assert not whole.has_gap
    assert np.trace(cut.covariance) > 2 * np.trace(whole.covariance)
    none = prediction.at(ImuSamples(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))), 0.5, config)
    assert np.isfinite(none.world_from_camera.matrix).all()


def test_a_time_before_the_state_is_the_states_own(imu, state):
    found = CameraPrediction(state, MOUNTING, np.eye(13)).at(imu, 0.1, ImuConfig())
    assert np.allclose(found.velocity_in_world, state.velocity_in_world)
