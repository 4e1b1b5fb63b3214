"""Poses that follow from start and IMU are as uncertain as they err, where both are drawn from what is told of them."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.geometry import Pose, exp_so3
from meshslam.graph import Smoother, SmootherConfig, StartConfig
from meshslam.motion import ImuConfig, Mounting, Preintegrator, predict, rate_at, state_of_camera
from meshslam.simulation import ImuNoise, simulated_imu

FRAMES, PERIOD_S, SEEDS = 12, 0.1, range(20)
MOUNTED = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([1.0, 0.1, 0.7]))
START, IMU = StartConfig(), ImuConfig(extrinsic_rotation_sigma_deg=1.0)


def true_path():
    """A bend at 10 m/s."""
    times = PERIOD_S * np.arange(FRAMES)
    yaw = 0.3 * times
    places = np.column_stack([10 * times, 1.5 * times**2, 0.05 * times])
    ahead = [Pose.from_yaw(float(a), p) for a, p in zip(yaw, places, strict=True)]
    return times, [pose @ Pose(MOUNTED.rotation, np.zeros(3)) for pose in ahead]


def run(seed, lag_s):
    """A smoother over a drawn drive; the live cameras with their covariances, and the truth."""
    rng = np.random.default_rng(seed)
    times, truth = true_path()
    readings = simulated_imu(times, truth, MOUNTED, ImuNoise(), rng)
    clock_s = rng.normal(0, IMU.time_offset_sigma_s)
    samples = replace(readings.samples, times_s=readings.samples.times_s - clock_s)
    turn = exp_so3(rng.normal(0, np.radians(IMU.extrinsic_rotation_sigma_deg), 3))
    mounted = Pose(MOUNTED.rotation @ turn, MOUNTED.translation)
    tilt, heading = np.radians([START.rotation_sigma_deg, START.heading_sigma_deg])
    first = Pose(
        exp_so3(rng.normal(0, [tilt, tilt, heading])) @ truth[0].rotation,
        truth[0].translation + rng.normal(0, START.position_sigma_m, 3),
    )
    velocity = readings.velocity_in_world + rng.normal(0, START.velocity_sigma_m_s, 3)
    state = state_of_camera(0.0, first, velocity, rate_at(samples, 0.0), mounted)
    smoother = Smoother(IMU, START, SmootherConfig(lag_s=lag_s), Mounting(mounted), keep_history=True)
    smoother.begin(state, rate_at(samples, 0.0))
    live = []
    for frame, time_s in enumerate(times.tolist()):
        if frame:
            interval = Preintegrator(IMU).between(samples, state.time_s, time_s, state)
            state = predict(state, interval, time_s)
            smoother.advance(state, interval)
        smoother.solve()
        found = smoother.estimate(frame)
        state = found.state
        live.append((found.world_from_camera, smoother.cameras.covariances([frame])[frame].world_from_camera))
        smoother.retire()
    return smoother, live, truth


def nees(poses, covariances, truth):
    """e^T C^-1 e over its dimension, by frame: of position, and of rotation."""
    rows = []
    for pose, covariance, true in zip(poses, covariances, truth, strict=True):
        error = pose.local(true)
        rows.append([error[p] @ np.linalg.solve(covariance[p, p], error[p]) / 3 for p in (slice(3), slice(3, 6))])
    return np.array(rows)


@pytest.mark.parametrize("lag_s", [0.5, 5.0])
def test_live_and_over_the_whole_path_errors_are_as_large_as_is_said(lag_s):
    live, end = [], []
    for seed in SEEDS:
        smoother, then, truth = run(seed, lag_s)
        live.append(nees(*zip(*then, strict=True), truth))
        full = smoother.full_trajectory((), 3)
        end.append(nees(full.world_from_camera, full.covariances(), truth))
    for found in (live, end):
        position, rotation = np.mean(found, axis=(0, 1))
        assert 0.7 < position < 1.3
        assert 0.7 < rotation < 1.3
        assert 0.6 < np.mean(found, axis=0)[0].mean() < 1.4  # the first camera's: known to the start's sigmas, not to
        # the mounting's, which are ten times larger


def test_the_whole_path_is_as_uncertain_as_the_window_that_holds_all_of_it():
    smoother, live, _ = run(0, 5.0)
    at_end = smoother.full_trajectory((), 3).covariances()
    held = smoother.cameras.covariances(range(FRAMES))
    scale = np.sqrt(np.diag(at_end[-1]))
    assert np.abs((at_end[-1] - live[-1][1]) / np.outer(scale, scale)).max() < 1e-3
    for frame in range(FRAMES):
        scale = np.sqrt(np.diag(at_end[frame]))
        assert np.abs((held[frame].world_from_camera - at_end[frame]) / np.outer(scale, scale)).max() < 1e-3


def test_what_is_not_seen_grows_more_uncertain():
    _, live, _ = run(1, 0.5)
    sigmas = [np.sqrt(np.trace(covariance[:3, :3])) for _, covariance in live]
    assert (np.diff(sigmas) > 0).all()
