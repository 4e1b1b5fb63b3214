"""From a state that a window holds to the camera a little later, by the IMU's samples, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.graph.camera_covariance import camera_covariance
from meshslam.graph.object_factor import place_camera
from meshslam.motion import ImuConfig, Interval, Mounting, NavState, Preintegrator, predict
from meshslam.sequences import ImuSamples


@dataclass(frozen=True, eq=False)
class PredictedCamera:
    """A camera between two updates of the window."""

    world_from_camera: Pose
    velocity_in_world: Floats  # (3,), m/s, of the IMU
    covariance: Floats  # (6, 6) of world_from_camera: right perturbation, (translation, rotation), m and rad
    has_gap: bool  # samples are missing


@dataclass(frozen=True, eq=False)
class CameraPrediction:
    """The newest state of a window, from which the next cameras are predicted."""

    state: NavState
    mounting: Mounting
    joint: Floats  # (13, 13), covariance of the IMU's pose X and velocity V, the mounting's E and T, in GTSAM's spaces

    def at(self, imu: ImuSamples, time_s: float, config: ImuConfig) -> PredictedCamera:
        """The camera at a time, at the earliest the state's; the samples are at least those in between.

        The covariance grows by the velocity's, and by the noise of the samples.
        """
        if not len(imu.times_s):  # none at all: straight on, which says little
            imu = _standing(self.state.time_s, config)
        time_s = max(time_s, self.state.time_s)
        interval = Preintegrator(config).between(imu, self.state.time_s, time_s, self.state)
        after = predict(self.state, interval, time_s)
        rate = interval.angular_rate_rad_s - self.state.gyroscope_bias
        since_s = time_s - self.state.time_s + self.mounting.time_offset_s
        place = place_camera(
            self.state.world_from_imu, self.state.velocity_in_world, self.mounting.imu_from_camera, since_s, rate
        )
        by_noise = place.by_imu @ _noise(interval) @ place.by_imu.T
        return PredictedCamera(
            self.mounting.world_from_camera(after, rate),
            after.velocity_in_world,
            camera_covariance(place, self.joint) + by_noise,
            interval.has_gap,
        )


def _noise(interval: Interval) -> Floats:
    """Covariance (6, 6) of (translation, rotation) that an interval's samples add, along the axes at its end."""
    found = np.asarray(interval.measurements.preintMeasCov())  # rotation, position, velocity, biases
    turn = np.eye(6)
    turn[:3, :3] = np.asarray(interval.measurements.deltaRij().matrix()).T
    order = [3, 4, 5, 0, 1, 2]
    noise: Floats = turn @ found[np.ix_(order, order)] @ turn.T
    return noise


def _standing(time_s: float, config: ImuConfig) -> ImuSamples:
    """One sample of an IMU that does not turn and is not accelerated, axes level."""
    return ImuSamples(np.array([time_s]), np.zeros((1, 3)), np.array([[0.0, 0.0, config.gravity_m_s2]]))
