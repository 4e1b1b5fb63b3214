"""From a rough start to the first state: the first seconds are run again and again until they settle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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


class Settling(Generic[_E]):
    """Runs the first seconds from a rough state, takes the state that they end up with, and runs them again from there.

    The first round runs as the frames come. `fresh` makes the estimator that is run. Within `lag_s` it still holds its
    first state. `start` is that state's prior: rounds end when what they begin with moves by little of its sigmas, and
    the run of the last goes on.
    """

    def __init__(
        self, found: NavState, fresh: Callable[[], _E], start: StartConfig, config: UnknownStartConfig, lag_s: float
    ) -> None:
        self._found, self._fresh, self._start, self._config = found, fresh, start, config
        self._seconds = settling_seconds(config, lag_s)
        self._estimator, self._reports = fresh(), list[Any]()

    def take(
        self,
        frame: int,
        time_s: float,
        imu: ImuSamples,
        detections: tuple[Detection, ...] | None,
        late: Mapping[int, tuple[Detection, ...]] | None = None,
    ) -> None:
        """The next frame of the first round; those after the first seconds are passed over.

        `detections` are None where nobody has looked at its image yet, and come as `late` ones, by frame, which not
        all estimators know.
        """
        if not self._reports:
            self._reports = [self._estimator.begin(frame, self._found, imu, detections or ())]
        elif time_s <= self._found.time_s + self._seconds:
            estimator: Any = self._estimator
            known = (detections,) if late is None else (detections, late)
            self._reports.append(estimator.process(frame, time_s, imu, *known))

    def settle(
        self,
        first: FirstFrames,
        imu: ImuSamples,
        detections_of_frame: Mapping[int, tuple[Detection, ...]],
        progress: Callable[[str, int, int], None] | None = None,
    ) -> Settled[_E]:
        """End the first round, and run the others; all frames of the first seconds were taken."""
        state, rounds = self._found, self._config.max_settling_rounds
        frames = first.frame_ids[: first.count_within(self._seconds)]
        for k in range(rounds):
            if k > 0:
                self._run(frames, first, state, imu, detections_of_frame)
            # biases begin anew: their prior would count twice, and they would run away from round to round
            before, after = state, self._estimator.first_state()
            biases = self._found.accelerometer_bias, self._found.gyroscope_bias
            state = replace(after, accelerometer_bias=biases[0], gyroscope_bias=biases[1])
            if progress is not None:
                progress("start", k + 1, rounds)
            if _moved(before, state, self._start) < _SETTLED:
                return Settled(state, self._estimator, tuple(self._reports))
        return Settled(state)

    def _run(
        self,
        frames: Sequence[int],
        first: FirstFrames,
        state: NavState,
        imu: ImuSamples,
        detections_of_frame: Mapping[int, tuple[Detection, ...]],
    ) -> None:
        self._estimator = self._fresh()
        for index, frame in enumerate(frames):
            detections = detections_of_frame.get(frame, ())
            if index == 0:
                self._reports = [self._estimator.begin(frame, state, imu, detections)]
            else:
                time_s = float(first.times_s[index])
                self._reports.append(self._estimator.process(frame, time_s, imu, detections))


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
    """`Settling` over frames that are all there."""
    settling = Settling(found, fresh, start, config, lag_s)
    for index in range(first.count_within(settling_seconds(config, lag_s))):
        frame = first.frame_ids[index]
        settling.take(frame, float(first.times_s[index]), imu, detections_of_frame.get(frame, ()))
    return settling.settle(first, imu, detections_of_frame, progress)


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
