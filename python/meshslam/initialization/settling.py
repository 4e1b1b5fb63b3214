"""From a rough start to the first state: the first seconds are run again and again until they settle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np

from meshslam.graph import StartConfig
from meshslam.initialization.config import UnknownStartConfig
from meshslam.initialization.first_frames import FirstFrames
from meshslam.motion import NavState
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples

_SETTLED = 0.003  # share of the speed by which another round moves it


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


def settled(
    first: FirstFrames,
    imu: ImuSamples,
    detections_of_frame: Mapping[int, tuple[Detection, ...]],
    found: NavState,
    fresh: Callable[[], Estimator],
    config: UnknownStartConfig,
    lag_s: float,
    progress: Callable[[str, int, int], None] | None = None,
) -> NavState:
    """Run the first seconds from a state, take the state that they end up with, and run them again from there.

    `fresh` makes the estimator that is run. Within `lag_s` it still holds its first state.
    """
    state, rounds = found, config.max_settling_rounds
    frames = first.frame_ids[: first.count_within(settling_seconds(config, lag_s))]
    for k in range(rounds):
        estimator = fresh()
        for index, frame in enumerate(frames):
            detections = detections_of_frame.get(frame, ())
            if index == 0:
                estimator.begin(frame, state, imu, detections)
            else:
                estimator.process(frame, float(first.times_s[index]), imu, detections)
        # biases begin anew: their prior would count twice, and they would run away from round to round
        before, after = state, estimator.first_state()
        state = replace(after, accelerometer_bias=found.accelerometer_bias, gyroscope_bias=found.gyroscope_bias)
        if progress is not None:
            progress("start", k + 1, rounds)
        moved = float(np.linalg.norm(state.velocity_in_world - before.velocity_in_world))
        if moved < _SETTLED * max(1.0, float(np.linalg.norm(state.velocity_in_world))):
            break
    return state


def settling_seconds(config: UnknownStartConfig, lag_s: float) -> float:
    """How much of the beginning is run again and again."""
    return min(config.settling_s, 0.9 * lag_s)
