"""Motion sources: IMU samples, known poses as odometry, or images alone predict each frame from the last one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from meshslam.features import ImageFeatures, two_views
from meshslam.geometry import Camera, Floats, Pose, log_so3
from meshslam.motion.config import ImuConfig, OdometryConfig
from meshslam.motion.imu import Interval, NavState, Preintegrator, RelativeMotion, predict, rate_at
from meshslam.sequences import ImuSamples

Tie = Interval | RelativeMotion


class MotionSource(Protocol):
    """Predicts each frame's state from the last one's."""

    @property
    def knows_velocity(self) -> bool:
        """Whether states' velocities are estimated, not just carried along."""

    def to_plain(self) -> dict[str, Any]:
        """What a saved run needs of it."""

    def fill(self, plain: Mapping[str, Any]) -> None:
        """The reverse of `to_plain`."""

    def first_rate(self, imu: ImuSamples, time_s: float) -> Floats:
        """Angular rate (3,) at the first frame."""

    def between(self, imu: ImuSamples, last: NavState, time_s: float, index: int) -> tuple[NavState, Tie]:
        """The state of frame `index` at a time, and what ties it to the last."""


@dataclass
class ImuMotion:
    """By preintegrated IMU samples."""

    config: ImuConfig

    def __post_init__(self) -> None:
        self._preintegrator = Preintegrator(self.config)

    @property
    def knows_velocity(self) -> bool:
        """See MotionSource."""
        return True

    def to_plain(self) -> dict[str, Any]:
        """Nothing: it holds no state."""
        return {}

    def fill(self, plain: Mapping[str, Any]) -> None:
        """See MotionSource."""

    def first_rate(self, imu: ImuSamples, time_s: float) -> Floats:
        """See MotionSource."""
        return rate_at(imu, time_s)

    def between(self, imu: ImuSamples, last: NavState, time_s: float, index: int) -> tuple[NavState, Tie]:
        """See MotionSource."""
        del index
        interval = self._preintegrator.between(imu, last.time_s, time_s, last)
        return predict(last, interval, time_s), interval


@dataclass(frozen=True, eq=False)
class OdometryMotion:
    """By the steps between known poses of the camera; the camera is the IMU, mounted on itself."""

    world_from_camera: Sequence[Pose]  # of each frame
    config: OdometryConfig

    @property
    def knows_velocity(self) -> bool:
        """See MotionSource."""
        return False

    def to_plain(self) -> dict[str, Any]:
        """Nothing: it holds no state."""
        return {}

    def fill(self, plain: Mapping[str, Any]) -> None:
        """See MotionSource."""

    def first_rate(self, imu: ImuSamples, time_s: float) -> Floats:
        """See MotionSource."""
        del imu, time_s
        return np.zeros(3)

    def between(self, imu: ImuSamples, last: NavState, time_s: float, index: int) -> tuple[NavState, Tie]:
        """See MotionSource."""
        del imu
        step = self.world_from_camera[index - 1].inverse() @ self.world_from_camera[index]
        far = self.config.translation_sigma_share * float(np.linalg.norm(step.translation))
        sigma_m = float(np.hypot(self.config.translation_sigma_m, far))
        sigmas = np.array([sigma_m] * 3 + [np.radians(self.config.rotation_sigma_deg)] * 3)
        return _stepped(last, time_s, step, sigmas)


@dataclass
class ImageMotion:
    """By the images alone: rotation and direction of each step by its corners, its length as the step before."""

    image_features: ImageFeatures
    camera: Camera
    config: OdometryConfig
    _before: NavState | None = None  # the state that the last step began with

    @property
    def knows_velocity(self) -> bool:
        """See MotionSource."""
        return False

    def to_plain(self) -> dict[str, Any]:
        """The state that the last step began with."""
        last = self._before
        return {} if last is None else {"time_s": last.time_s, "world_from_camera": last.world_from_imu.matrix.tolist()}

    def fill(self, plain: Mapping[str, Any]) -> None:
        """See MotionSource."""
        if plain:
            zero, pose = np.zeros(3), Pose.restored(np.array(plain["world_from_camera"]))
            self._before = NavState(plain["time_s"], pose, zero, zero, zero)

    def first_rate(self, imu: ImuSamples, time_s: float) -> Floats:
        """See MotionSource."""
        del imu, time_s
        return np.zeros(3)

    def between(self, imu: ImuSamples, last: NavState, time_s: float, index: int) -> tuple[NavState, Tie]:
        """See MotionSource."""
        del imu
        period_s, speed = time_s - last.time_s, float(np.linalg.norm(last.velocity_in_world))
        if self._before is not None and index > 1:
            moved = last.world_from_imu.translation - self._before.world_from_imu.translation
            speed = float(np.linalg.norm(moved)) / (last.time_s - self._before.time_s)
        self._before = last
        seen = two_views(self.image_features.matches(index), self.camera)
        step = Pose(seen.rotation, seen.translation * speed * period_s)
        sigma_m, sigma_rad = self.config.acceleration_m_s2 * period_s**2, self.config.turning_rad_s2 * period_s**2
        return _stepped(last, time_s, step, np.array([sigma_m] * 3 + [sigma_rad] * 3))


def _stepped(last: NavState, time_s: float, step: Pose, sigmas: Floats) -> tuple[NavState, Tie]:
    period_s, pose = time_s - last.time_s, last.world_from_imu @ step
    velocity = (pose.translation - last.world_from_imu.translation) / period_s
    state = replace(last, time_s=time_s, world_from_imu=pose, velocity_in_world=velocity)
    return state, RelativeMotion(step, sigmas, np.asarray(log_so3(step.rotation), float) / period_s)
