"""How SLAM starts: from a state that is given, from odometry, or from what the first seconds show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from meshslam.features import ImageFeatures
from meshslam.geometry import Floats, Pose
from meshslam.initialization import (
    FirstFrames,
    RoughStart,
    Settling,
    rough_start,
    rough_start_by_images,
    settling_seconds,
    unknown_start,
)
from meshslam.motion import NavState, first_velocity, rate_at, state_of_camera
from meshslam.object_slam.estimator import SlamEstimator, SlamReport
from meshslam.object_slam.setup import SlamSetup
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples, InitialState

_ODOMETRY_FRAMES = 3  # for the velocity at the first
NO_IMU = ImuSamples(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class StreamFrame:
    """One frame as the estimator takes it."""

    number: int
    time_s: float
    detections: tuple[Detection, ...] | None  # with tracks; None where nobody has looked at the image yet


@dataclass(frozen=True, eq=False)
class Start:
    """The first state and the setup to begin with it; where it was searched, the run that found it."""

    state: NavState
    setup: SlamSetup
    estimator: SlamEstimator | None = None
    reports: tuple[SlamReport, ...] = ()  # of its frames


@dataclass(eq=False)
class SettlingStart:
    """A start that is being searched, and the setup that it is searched with."""

    setup: SlamSetup
    settling: Settling[SlamEstimator]


@dataclass(frozen=True, eq=False)
class FirstSeconds:
    """Frames and samples that were taken in before SLAM has started."""

    setup: SlamSetup
    given: InitialState | None
    frames: Sequence[StreamFrame]
    imu: ImuSamples  # none by odometry or by images alone
    odometry: Sequence[Pose]  # world_from_camera of each frame, where poses are the odometry
    image_features: ImageFeatures | None
    source: str  # what messages call the recording

    @property
    def has_imu(self) -> bool:
        """Whether the IMU moves the camera."""
        return len(self.imu.times_s) > 0

    def suffice(self) -> bool:
        """Whether there are enough frames to start."""
        if self.odometry:
            return len(self.frames) >= _ODOMETRY_FRAMES
        if self.given is not None and self.has_imu:
            return True
        unknown = self.setup.estimation.unknown_start
        seconds = max(unknown.alignment.seconds, settling_seconds(unknown, self.setup.slam.lag_s))
        return self.frames[-1].time_s - self.frames[0].time_s > seconds

    def suffice_for_rough_start(self) -> bool:
        """Whether a start that is to be searched can begin to settle."""
        if self.odometry or (self.given is not None and self.has_imu):
            return False
        passed_s = self.frames[-1].time_s - self.frames[0].time_s
        return passed_s > self.setup.estimation.unknown_start.alignment.seconds

    def start(
        self,
        fresh: Callable[[SlamSetup], SlamEstimator],
        settling: SettlingStart | None = None,
        progress: Callable[[str, int, int], None] | None = None,
    ) -> Start:
        """The first state, and the setup to begin with it; SequenceError where the frames do not tell."""
        first_s = self.frames[0].time_s
        if self.odometry:
            velocity, zero = first_velocity(self._times_s(), tuple(self.odometry)), np.zeros(3)
            return Start(NavState(first_s, self.odometry[0], velocity, zero, zero), self.setup)
        if self.given is not None and self.has_imu:
            pose, velocity = self.given.world_from_camera, self.given.velocity_in_world
            mounted = self.setup.mounting.imu_from_camera
            return Start(state_of_camera(first_s, pose, velocity, rate_at(self.imu, first_s), mounted), self.setup)
        begun = settling or self.settling(fresh)
        by_frame = {f.number: f.detections for f in self.frames if f.detections is not None}
        found = begun.settling.settle(self._first(), self.imu, by_frame, progress)
        return Start(found.state, begun.setup, found.estimator, found.reports)

    def settling(self, fresh: Callable[[SlamSetup], SlamEstimator]) -> SettlingStart:
        """Begin to settle from what gravity and the objects' boxes tell; SequenceError where they do not tell."""
        estimation = self.setup.estimation
        rough, unknown = self._rough(), estimation.unknown_start
        start = unknown_start(estimation.start, unknown, float(np.linalg.norm(rough.state.velocity_in_world)))
        setup = replace(self.setup, estimation=replace(estimation, start=start))
        settling = Settling(rough.state, partial(fresh, setup), start, unknown, setup.slam.lag_s)
        for frame in self.frames:
            settling.take(frame.number, frame.time_s, self.imu, frame.detections)
        return SettlingStart(setup, settling)

    def _rough(self) -> RoughStart:
        setup, category = self.setup, self.setup.category
        height_m, alignment = category.dimensions[2], setup.estimation.unknown_start.alignment
        sized = [(d, height_m) for f in self.frames for d in f.detections or () if d.category == category.name]
        imu = setup.estimation.imu
        if not self.has_imu:
            assert self.image_features is not None
            return rough_start_by_images(self._first(), self.image_features, sized, imu.gravity_m_s2, alignment)
        return rough_start(self._first(), self.imu, setup.mounting.imu_from_camera, sized, imu, alignment)

    def _first(self) -> FirstFrames:
        numbers, height = tuple(f.number for f in self.frames), self.setup.height_above_ground_m
        return FirstFrames(self.setup.camera, numbers, self._times_s(), height, self.source)

    def _times_s(self) -> Floats:
        return np.array([f.time_s for f in self.frames])
