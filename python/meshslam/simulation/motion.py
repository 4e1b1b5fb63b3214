"""A smooth motion through camera poses, and what an IMU on board reads along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from meshslam.geometry import Floats, Pose
from meshslam.motion import ImuConfig
from meshslam.sequences import ImuSamples
from meshslam.settings import Settings, setting

RATE_HZ = 100.0
MARGIN_S = 0.02  # of IMU samples before the first and after the last frame
GRAVITY_M_S2 = ImuConfig.gravity_m_s2
# the IMU looks forward, left, up; the camera is mounted in front of it
IMU_FROM_CAMERA = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([1.0, 0.3, 0.7]))


@dataclass(frozen=True)
class ImuNoise(Settings):
    """Errors of an IMU by their Allan parameters: white noise, and random walk of the bias; continuous densities.

    The defaults are those that localization reckons with.
    """

    gyroscope_noise: float = setting(ImuConfig.gyroscope_noise, low=0, unit="rad/s/√Hz")
    accelerometer_noise: float = setting(ImuConfig.accelerometer_noise, low=0, unit="m/s²/√Hz")
    gyroscope_walk: float = setting(ImuConfig.gyroscope_walk, low=0, unit="rad/s²/√Hz")
    accelerometer_walk: float = setting(ImuConfig.accelerometer_walk, low=0, unit="m/s³/√Hz")
    gyroscope_bias_rad_s: float = setting(ImuConfig.gyroscope_bias_sigma_rad_s, low=0)  # sigma at the start
    accelerometer_bias_m_s2: float = setting(ImuConfig.accelerometer_bias_sigma_m_s2, low=0)  # sigma at the start


@dataclass(frozen=True, eq=False)
class ImuReadings:
    """What an IMU read on the camera's path, and how it is mounted."""

    samples: ImuSamples
    imu_from_camera: Pose
    velocity_in_world: Floats  # (3,), m/s, of the camera at the first frame


class Motion:
    """Poses as a function of time: cubic splines through those of the frames, two at least."""

    def __init__(self, times_s: Floats, poses: Sequence[Pose]) -> None:
        self._places = CubicSpline(times_s, [pose.translation for pose in poses])
        self._turns = RotationSpline(times_s, Rotation.from_matrix(np.stack([pose.rotation for pose in poses])))

    def pose(self, time_s: float) -> Pose:
        """world_from_body."""
        return Pose(np.asarray(self._turns(time_s).as_matrix(), float), np.asarray(self._places(time_s), float))

    def velocity(self, time_s: float, point_in_body: Floats | None = None) -> Floats:
        """Velocity (3,) in world, m/s, of the origin or of another point (3,) of the body."""
        moved = np.asarray(self._places(time_s, 1), float)
        if point_in_body is None:
            return moved
        swing: Floats = np.cross(np.asarray(self._turns(time_s, 1), float), point_in_body)
        carried: Floats = moved + self.pose(time_s).rotation @ swing
        return carried

    def ideal_imu(self, times_s: Floats) -> ImuSamples:
        """Angular rate and specific force in the body's frame, without errors."""
        pull = np.asarray(self._places(times_s, 2), float) + [0.0, 0.0, GRAVITY_M_S2]
        force = self._turns(times_s).inv().apply(pull)
        return ImuSamples(times_s, np.asarray(self._turns(times_s, 1), float), np.asarray(force, float))


def simulated_imu(
    times_s: Floats, world_from_camera: Sequence[Pose], imu_from_camera: Pose, noise: ImuNoise, rng: np.random.Generator
) -> ImuReadings:
    """What an IMU that carries the camera reads from just before the first to just after the last frame."""
    camera_from_imu = imu_from_camera.inverse()
    motion = Motion(times_s, [pose @ camera_from_imu for pose in world_from_camera])
    count = int(np.ceil((times_s[-1] - times_s[0] + 2 * MARGIN_S) * RATE_HZ)) + 1
    ideal = motion.ideal_imu(times_s[0] - MARGIN_S + np.arange(count) / RATE_HZ)
    rate = _errors(rng, count, noise.gyroscope_noise, noise.gyroscope_walk, noise.gyroscope_bias_rad_s)
    force = _errors(rng, count, noise.accelerometer_noise, noise.accelerometer_walk, noise.accelerometer_bias_m_s2)
    samples = ImuSamples(ideal.times_s, ideal.angular_rate_rad_s + rate, ideal.specific_force_m_s2 + force)
    velocity = motion.velocity(float(times_s[0]), imu_from_camera.translation)
    return ImuReadings(samples, imu_from_camera, velocity)


def _errors(rng: np.random.Generator, count: int, density: float, walk: float, bias_sigma: float) -> Floats:
    """Bias at the start, its random walk, and white noise: (count, 3)."""
    steps = rng.normal(0.0, walk / np.sqrt(RATE_HZ), (count, 3))
    bias = rng.normal(0.0, bias_sigma, 3) + np.cumsum(steps, axis=0) - steps[0]
    errors: Floats = bias + rng.normal(0.0, density * np.sqrt(RATE_HZ), (count, 3))
    return errors
