"""From a rough start to the first state: the first seconds are run again and again until they settle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from meshslam.localization.config import LocalizationConfig
from meshslam.localization.imu import NavState
from meshslam.localization.rough_start import frames_within
from meshslam.perception import Detection, DetectionSet
from meshslam.sequences import ImuSamples, Sequence

_SETTLED = 0.003  # share of the speed by which another round moves it


def loose(config: LocalizationConfig, speed_m_s: float) -> LocalizationConfig:
    """The settings for a start that is roughly known: velocity, roll and pitch are loose, place and heading are not."""
    start = config.start
    velocity_sigma = float(np.hypot(start.unknown_velocity_sigma_m_s, start.unknown_velocity_share * speed_m_s))
    tilt = start.unknown_tilt_sigma_deg
    return replace(config, start=replace(start, rotation_sigma_deg=tilt, velocity_sigma_m_s=velocity_sigma))


class Estimator(Protocol):
    """What runs frame by frame from a state, and knows afterwards what the first one was."""

    def begin(self, frame: int, state: NavState, imu: ImuSamples, detections: tuple[Detection, ...]) -> object:
        """The first frame."""

    def process(self, frame: int, time_s: float, imu: ImuSamples, detections: tuple[Detection, ...]) -> object:
        """The next frame."""

    def first_state(self) -> NavState:
        """The first frame's state as it is now seen."""


def settled(
    sequence: Sequence,
    imu: ImuSamples,
    detections: DetectionSet,
    first: NavState,
    fresh: Callable[[LocalizationConfig], Estimator],
    config: LocalizationConfig,
    lag_s: float,
    progress: Callable[[str, int, int], None] | None = None,
) -> NavState:
    """Run the first seconds from a state, take the state that they end up with, and run them again from there.

    Within `lag_s` the estimator still holds its first state.
    """
    seconds = min(config.start.settling_s, 0.9 * lag_s)
    state, rounds = first, config.start.settling_rounds
    by_frame, frames = detections.by_frame(), frames_within(sequence, seconds)
    for k in range(rounds):
        estimator = fresh(config)
        for index, frame in enumerate(sequence.frame_ids[:frames]):
            seen = by_frame.get(frame, ())
            if index == 0:
                estimator.begin(frame, state, imu, seen)
            else:
                estimator.process(frame, float(sequence.times_s[index]), imu, seen)
        # biases begin anew: their prior would count twice, and they would run away from round to round
        before, found = state, estimator.first_state()
        state = replace(found, accelerometer_bias=first.accelerometer_bias, gyroscope_bias=first.gyroscope_bias)
        if progress is not None:
            progress("start", k + 1, rounds)
        moved = float(np.linalg.norm(state.velocity_in_world - before.velocity_in_world))
        if moved < _SETTLED * max(1.0, float(np.linalg.norm(state.velocity_in_world))):
            break
    return state
