"""From a rough start to the first state: the first seconds are run again and again until they settle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from meshslam.geometry import log_so3
from meshslam.graph import StartConfig
from meshslam.initialization.config import UnknownStartConfig
from meshslam.initialization.first_frames import FirstFrames
from meshslam.motion import NavState
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples

_SETTLED = 0.1  # of the start's sigmas: another round would begin no further away
_LEAST_M = 0.1  # of the place's sigma, which is small where the first pose is the world's origin


def unknown_start(start: StartConfig, unknown: UnknownStartConfig, speed_m_s: float) -> StartConfig:
    """The priors of a start that was found: velocity, roll and pitch are uncertain, place and heading are not."""
    velocity_sigma = float(np.hypot(unknown.velocity_sigma_m_s, unknown.velocity_sigma_share * speed_m_s))
    return replace(start, rotation_sigma_deg=unknown.tilt_sigma_deg, velocity_sigma_m_s=velocity_sigma)


class Estimator(Protocol):
    """What runs frame by frame from a state, and knows afterwards what the first one was."""

    def begin(self, frame: int, state: NavState, imu: ImuSamples, detections: tuple[Detection, ...]) -> object:
        """The first frame."""

    def process(self, frame: int, time_s: float, imu: ImuSamples, detections: tuple[Detection, ...]) -> object:
        """The next frame."""

    def first_state(self) -> NavState:
        """The current estimate of the first frame's state."""


_E = TypeVar("_E", bound=Estimator)


@dataclass(frozen=True, eq=False)
class Settled(Generic[_E]):
    """The first state, and the run that showed that it stays where it is."""

    state: NavState
    estimator: _E | None = None  # after the first seconds; None where they did not settle: run them again
    reports: tuple[Any, ...] = ()  # what each of its frames brought


def settled(
    first: FirstFrames,
    imu: ImuSamples,
    detections_of_frame: Mapping[int, tuple[Detection, ...]],
    found: NavState,
    fresh: Callable[[], _E],
    start: StartConfig,
    config: UnknownStartConfig,
    lag_s: float,
    progress: Callable[[str, int, int], None] | None = None,
) -> Settled[_E]:
    """Run the first seconds from a state, take the state that they end up with, and run them again from there.

    `fresh` makes the estimator that is run. Within `lag_s` it still holds its first state. `start` is that state's
    prior: rounds end when what they begin with moves by little of its sigmas, and the run of the last goes on.
    """
    state, rounds = found, config.max_settling_rounds
    frames = first.frame_ids[: first.count_within(settling_seconds(config, lag_s))]
    for k in range(rounds):
        estimator = fresh()
        for index, frame in enumerate(frames):
            detections = detections_of_frame.get(frame, ())
            if index == 0:
                reports = [estimator.begin(frame, state, imu, detections)]
            else:
                reports.append(estimator.process(frame, float(first.times_s[index]), imu, detections))
        # biases begin anew: their prior would count twice, and they would run away from round to round
        before, after = state, estimator.first_state()
        state = replace(after, accelerometer_bias=found.accelerometer_bias, gyroscope_bias=found.gyroscope_bias)
        if progress is not None:
            progress("start", k + 1, rounds)
        if _moved(before, state, start) < _SETTLED:
            return Settled(state, estimator, tuple(reports))
    return Settled(state)


def _moved(before: NavState, after: NavState, start: StartConfig) -> float:
    """By how many of the prior's sigmas the first state has moved."""
    step = before.world_from_imu.inverse() @ after.world_from_imu
    turned_deg = float(np.degrees(np.linalg.norm(log_so3(step.rotation))))
    faster_m_s = float(np.linalg.norm(after.velocity_in_world - before.velocity_in_world))
    moved_m = float(np.linalg.norm(step.translation))
    sigmas = (start.rotation_sigma_deg, start.velocity_sigma_m_s, max(start.position_sigma_m, _LEAST_M))
    return max(x / sigma for x, sigma in zip((turned_deg, faster_m_s, moved_m), sigmas, strict=True))


def settling_seconds(config: UnknownStartConfig, lag_s: float) -> float:
    """How much of the beginning is run again and again."""
    return min(config.settling_s, 0.9 * lag_s)
