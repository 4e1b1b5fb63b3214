"""Inertial odometry: the path that the IMU alone gives."""

from __future__ import annotations

import numpy as np

from meshslam.errors import SequenceError
from meshslam.geometry import Floats, Pose
from meshslam.motion.config import ImuConfig
from meshslam.motion.imu import Mounting, NavState, Preintegrator, predict, rate_at, state_of_camera
from meshslam.sequences import ImuSamples, Sequence


def start_state(sequence: Sequence, imu: ImuSamples, imu_from_camera: Pose) -> NavState:
    """The first frame's state: initial_state.yaml, else the first of the known poses."""
    given = sequence.initial_state
    first_s = float(sequence.times_s[0])
    if given is not None:
        period_s = float(np.median(np.diff(sequence.times_s))) if len(sequence) > 1 else 0.1
        if abs(given.time_s - first_s) > period_s:
            raise SequenceError(
                f"{sequence.root / 'initial_state.yaml'}: timestamp: {given.time_s:.3f} s is not the first frame's, "
                f"{first_s:.3f} s"
            )
        pose, velocity = given.world_from_camera, given.velocity_in_world
    elif sequence.world_from_camera is not None and len(sequence) > 1:
        pose, velocity = sequence.world_from_camera[0], first_velocity(sequence.times_s, sequence.world_from_camera)
    else:
        raise SequenceError(f"{sequence.root}: no start: initial_state.yaml or known poses of the camera are needed")
    return state_of_camera(first_s, pose, velocity, rate_at(imu, first_s), imu_from_camera)


def first_velocity(times_s: Floats, poses: tuple[Pose, ...]) -> Floats:
    """Velocity (3,) at the first of these poses: the derivative of a parabola through the first three."""
    at = times_s[: min(3, len(poses))] - times_s[0]
    points = np.array([pose.translation for pose in poses[: len(at)]])
    fitted: Floats = np.polyfit(at, points, len(at) - 1)[-2]
    return fitted


def inertial_path(
    imu: ImuSamples, times_s: Floats, start: NavState, mounting: Mounting, config: ImuConfig
) -> tuple[Pose, ...]:
    """world_from_camera at each time by integration alone, from the state at the first."""
    preintegrator, state = Preintegrator(config), start
    poses = [mounting.world_from_camera(state, rate_at(imu, state.time_s) - state.gyroscope_bias)]
    for end_s in times_s[1:].tolist():
        interval = preintegrator.between(imu, state.time_s, end_s, state)
        state = predict(state, interval, end_s)
        poses.append(mounting.world_from_camera(state, interval.angular_rate_rad_s - state.gyroscope_bias))
    return tuple(poses)
