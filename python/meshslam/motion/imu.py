"""IMU samples between frames: checked, cut, preintegrated (Forster et al. 2017; GTSAM's combined factor)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import gtsam
import numpy as np

from meshslam.errors import SequenceError
from meshslam.geometry import Floats, Pose, exp_so3
from meshslam.motion.config import ImuConfig
from meshslam.motion.gtsam_bridge import from_pose3, to_pose3
from meshslam.sequences import ImuSamples
from meshslam.sequences import Sequence as Recording


@dataclass(frozen=True, eq=False)
class NavState:
    """Pose, velocity and biases of the IMU at a time on its own clock."""

    time_s: float
    world_from_imu: Pose
    velocity_in_world: Floats  # (3,), m/s
    accelerometer_bias: Floats  # (3,), m/s2
    gyroscope_bias: Floats  # (3,), rad/s


@dataclass(frozen=True)
class ImuNoise:
    """What preintegration is told of an IMU; densities as in `ImuConfig`."""

    gravity_m_s2: float
    gyroscope: float
    accelerometer: float
    gyroscope_walk: float
    accelerometer_walk: float


@dataclass(frozen=True, eq=False)
class Readings:
    """What is preintegrated: the samples of an interval and the biases that they are integrated with."""

    steps: Floats  # (n, 7): mean specific force, m/s2, mean angular rate, rad/s, and duration, s, from sample to sample
    biases: Floats  # (6,), of accelerometer and gyroscope
    noise: ImuNoise

    def preintegrated(self) -> gtsam.PreintegratedCombinedMeasurements:
        """Integrate them; equal readings give equal bits."""
        bias = gtsam.imuBias.ConstantBias(self.biases[:3], self.biases[3:])
        out = gtsam.PreintegratedCombinedMeasurements(_params(self.noise), bias)
        for row in self.steps:
            out.integrateMeasurement(row[:3], row[3:6], float(row[6]))
        return out


@dataclass(frozen=True, eq=False)
class Interval:
    """Preintegrated samples between two times."""

    readings: Readings
    measurements: gtsam.PreintegratedCombinedMeasurements  # of the readings
    angular_rate_rad_s: Floats  # (3,), measured at the end
    has_gap: bool


@dataclass(frozen=True, eq=False)
class RelativeMotion:
    """The step from one frame's camera to the next one's, where no IMU tells."""

    first_from_second: Pose
    sigmas: Floats  # (6,), of (translation, rotation)
    angular_rate_rad_s: Floats  # (3,)
    has_gap: bool = False


def check_imu(sequence: Recording, config: ImuConfig) -> tuple[ImuSamples, Pose]:
    """The sequence's IMU and imu_from_camera; SequenceError in clear words where inertial odometry cannot work."""
    imu, root = sequence.imu, sequence.root
    if imu is None:
        raise SequenceError(
            f"{root}: no IMU: imu.csv in a sequence folder, oxts in KITTI raw, or --imu FILE "
            "(imu='FILE' of open_sequence) is needed"
        )
    if sequence.imu_from_camera is None:
        raise SequenceError(
            f"{root}: an IMU without extrinsics: imu_from_camera (4x4) in camera.yaml, or --imu-from-camera FILE"
        )
    first, last = float(sequence.times_s[0]), float(sequence.times_s[-1])
    begins, ends = float(imu.times_s[0]), float(imu.times_s[-1])
    if begins > last or ends < first:
        raise SequenceError(
            f"{root}: IMU and frames do not overlap: samples from {begins:.3f} s to {ends:.3f} s, "
            f"frames from {first:.3f} s to {last:.3f} s: another clock?"
        )
    rate_hz = sample_rate_hz(imu)
    if rate_hz < config.min_rate_hz:
        raise SequenceError(
            f"{root}: the IMU has {rate_hz:.1f} Hz, at least {config.min_rate_hz:.0f} Hz are needed "
            "(KITTI raw: put the drive's _extract folder beside its _sync folder)"
        )
    return imu, sequence.imu_from_camera


def sample_rate_hz(imu: ImuSamples) -> float:
    """Samples a second between gaps: one over the median period; 0 for fewer than two samples."""
    return 1.0 / float(np.median(np.diff(imu.times_s))) if len(imu.times_s) > 1 else 0.0


class Preintegrator:
    """Cuts samples to intervals, and integrates each."""

    def __init__(self, config: ImuConfig) -> None:
        self.config = config
        self._usual = _noise(config, config.gyroscope_noise, config.accelerometer_noise)
        self._in_gap = _noise(config, config.gap_gyroscope_noise, config.gap_accelerometer_noise)

    def between(self, imu: ImuSamples, start_s: float, end_s: float, state: NavState) -> Interval:
        """Integrate from start to end with the biases of a state.

        Rates are linear between samples and constant beyond the first and the last; where samples are missing the
        interval says little.
        """
        times = imu.times_s
        first, last = np.searchsorted(times, start_s, side="right"), np.searchsorted(times, end_s, side="left")
        at = np.concatenate([[start_s], times[first:last], [end_s]])
        near = slice(max(0, first - 1), min(len(times), last + 1))
        columns = np.column_stack([imu.specific_force_m_s2[near], imu.angular_rate_rad_s[near]])
        values = np.column_stack([np.interp(at, times[near], column) for column in columns.T])
        has_gap = self._has_gap(times[near], start_s, end_s, sample_rate_hz(imu))
        steps = np.column_stack([0.5 * (values[1:] + values[:-1]), np.diff(at)])
        biases = np.concatenate([state.accelerometer_bias, state.gyroscope_bias])
        readings = Readings(steps[steps[:, 6] > 1e-9], biases, self._in_gap if has_gap else self._usual)
        return Interval(readings, readings.preintegrated(), values[-1, 3:], has_gap)

    def _has_gap(self, near_s: Floats, start_s: float, end_s: float, rate_hz: float) -> bool:
        longest = self.config.gap_periods / max(rate_hz, 1e-9)
        pauses = np.diff(np.concatenate([[min(start_s, near_s[0])], near_s, [max(end_s, near_s[-1])]]))
        return bool(pauses.max() > longest)


def predict(state: NavState, interval: Interval, end_s: float) -> NavState:
    """The state after an interval."""
    bias = gtsam.imuBias.ConstantBias(state.accelerometer_bias, state.gyroscope_bias)
    after = interval.measurements.predict(gtsam.NavState(to_pose3(state.world_from_imu), state.velocity_in_world), bias)
    moved = from_pose3(after.pose())
    velocity = np.asarray(after.velocity(), float)
    return NavState(end_s, moved, velocity, state.accelerometer_bias, state.gyroscope_bias)


@dataclass(frozen=True, eq=False)
class Mounting:
    """How the camera is mounted on the IMU, and how their clocks differ."""

    imu_from_camera: Pose
    time_offset_s: float = 0.0  # of the IMU's clock beyond the offset that the samples' times know already

    def world_from_camera(self, state: NavState, angular_rate_rad_s: Floats) -> Pose:
        """The camera when it took the frame: `time_offset_s` after the state; the rate (3,) is free of bias."""
        turned = state.world_from_imu.rotation @ exp_so3(angular_rate_rad_s * self.time_offset_s)
        moved = state.world_from_imu.translation + state.velocity_in_world * self.time_offset_s
        arm = self.imu_from_camera.translation
        return Pose(turned @ self.imu_from_camera.rotation, moved + turned @ arm)


def state_of_camera(
    time_s: float, world_from_camera: Pose, camera_velocity: Floats, rate_rad_s: Floats, imu_from_camera: Pose
) -> NavState:
    """The IMU's state from the camera's pose and velocity (3,) in the world; biases are 0, the lever arm counts."""
    world_from_imu = world_from_camera @ imu_from_camera.inverse()
    swing = world_from_imu.rotation @ np.cross(rate_rad_s, imu_from_camera.translation)
    return NavState(time_s, world_from_imu, camera_velocity - swing, np.zeros(3), np.zeros(3))


def rate_at(imu: ImuSamples, time_s: float) -> Floats:
    """Measured angular rate (3,) at a time."""
    return np.array([np.interp(time_s, imu.times_s, column) for column in imu.angular_rate_rad_s.T])


def mean_specific_force(imu: ImuSamples, times_s: Floats, frame_from_imu: Sequence[Floats]) -> Floats:
    """Mean specific force (3,) over times, each turned by its rotation (3, 3) into a common frame."""
    forces = np.array([np.interp(times_s, imu.times_s, column) for column in imu.specific_force_m_s2.T]).T
    mean: Floats = np.mean([turn @ force for turn, force in zip(frame_from_imu, forces, strict=True)], axis=0)
    return mean


def _noise(config: ImuConfig, gyroscope: float, accelerometer: float) -> ImuNoise:
    walks = config.gyroscope_walk, config.accelerometer_walk
    return ImuNoise(config.gravity_m_s2, gyroscope, accelerometer, *walks)


@lru_cache(maxsize=16)
def _params(noise: ImuNoise) -> gtsam.PreintegrationCombinedParams:
    params = gtsam.PreintegrationCombinedParams.MakeSharedU(noise.gravity_m_s2)
    params.setGyroscopeCovariance(noise.gyroscope**2 * np.eye(3))
    params.setAccelerometerCovariance(noise.accelerometer**2 * np.eye(3))
    params.setIntegrationCovariance(1e-8 * np.eye(3))
    params.setBiasAccCovariance(noise.accelerometer_walk**2 * np.eye(3))
    params.setBiasOmegaCovariance(noise.gyroscope_walk**2 * np.eye(3))
    return params
