import dataclasses

import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.geometry import Pose, exp_so3
from meshslam.motion import ImuConfig, inertial_path, start_state
from meshslam.motion.imu import Mounting, NavState, Preintegrator, check_imu, predict, state_of_camera
from meshslam.sequences import ImuSamples
from tests.fixtures.imu_street import IMU_FROM_CAMERA, errors_m, samples_of


def curve(t):
    """A bend of 20 m radius with some pitch, 8 m/s."""
    turn = exp_so3(np.array([0.0, 0.0, 0.4 * t])) @ exp_so3(np.array([0.0, 0.05 * np.sin(t), 0.0]))
    return Pose(turn, np.array([20 * np.sin(0.4 * t), 20 * (1 - np.cos(0.4 * t)), 0.1 * t]))


def velocity_of(path, t, step=1e-5):
    return (path(t + step).translation - path(t - step).translation) / (2 * step)


def test_an_ideal_imu_gives_the_path_back():
    imu, times = samples_of(curve, np.arange(-0.02, 3.02, 0.01)), np.arange(0, 3.01, 0.1037)
    camera = [curve(t) @ IMU_FROM_CAMERA for t in times]
    rate = samples_of(curve, [0.0]).angular_rate_rad_s[0]
    velocity = velocity_of(lambda t: curve(t) @ IMU_FROM_CAMERA, 0.0)
    start = state_of_camera(0.0, camera[0], velocity, rate, IMU_FROM_CAMERA)
    assert np.allclose(start.velocity_in_world, velocity_of(curve, 0.0), atol=1e-4)
    path = inertial_path(imu, times, start, Mounting(IMU_FROM_CAMERA), ImuConfig())
    assert errors_m(path, camera).max() < 0.03  # of 24 m: the samples' middles stand for 10 ms each


def test_frames_between_samples_do_not_matter():
    imu = samples_of(curve, np.arange(-0.02, 1.02, 0.01))
    start = NavState(0.0, curve(0.0), velocity_of(curve, 0.0), np.zeros(3), np.zeros(3))
    integrate = Preintegrator(ImuConfig())
    whole = predict(start, integrate.between(imu, 0.0, 0.955, start), 0.955)
    half = predict(start, integrate.between(imu, 0.0, 0.4321, start), 0.4321)
    parts = predict(half, integrate.between(imu, 0.4321, 0.955, half), 0.955)
    assert np.allclose(whole.world_from_imu.matrix, parts.world_from_imu.matrix, atol=1e-3)


@pytest.mark.parametrize(("lost", "expected"), [((0.3, 0.5), True), ((0.3, 0.32), False), ((0.9, 2.0), True)])
def test_a_gap_is_seen(lost, expected):
    imu = samples_of(curve, np.arange(0, 1.02, 0.01))
    keep = (imu.times_s < lost[0]) | (imu.times_s > lost[1])
    imu = ImuSamples(imu.times_s[keep], imu.angular_rate_rad_s[keep], imu.specific_force_m_s2[keep])
    start = NavState(0.0, curve(0.0), np.zeros(3), np.zeros(3), np.zeros(3))
    sure = Preintegrator(ImuConfig()).between(imu, 0.0, 0.2, start)
    found = Preintegrator(ImuConfig()).between(imu, 0.2, 1.0, start)
    assert not sure.has_gap
    assert found.has_gap == expected


def test_bad_imus_are_refused_in_clear_words(drive):
    def error(**changes):
        with pytest.raises(SequenceError) as caught:
            check_imu(dataclasses.replace(drive, **changes), ImuConfig())
        return str(caught.value)

    assert "no IMU" in error(imu=None)
    assert "without extrinsics" in error(imu_from_camera=None)
    late = dataclasses.replace(drive.imu, times_s=drive.imu.times_s + 100)
    assert "do not overlap" in error(imu=late)
    slow = ImuSamples(
        *(a[::10] for a in (drive.imu.times_s, drive.imu.angular_rate_rad_s, drive.imu.specific_force_m_s2))
    )
    assert "10.0 Hz, at least 50 Hz" in error(imu=slow)


def test_no_start_is_said(drive):
    with pytest.raises(SequenceError, match="no start"):
        start_state(dataclasses.replace(drive, initial_state=None), drive.imu, IMU_FROM_CAMERA)
    known = tuple(Pose(np.eye(3), np.array([0.1 * k**2, k, 0.0])) for k in range(len(drive)))
    found = start_state(
        dataclasses.replace(drive, initial_state=None, world_from_camera=known),
        dataclasses.replace(drive.imu, angular_rate_rad_s=0 * drive.imu.angular_rate_rad_s),
        IMU_FROM_CAMERA,
    )
    period = drive.times_s[1] - drive.times_s[0]
    assert np.allclose(found.velocity_in_world, [0, 1 / period, 0], atol=1e-6)
