"""Frames and IMU samples as a stream brings them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.localization.imu import NavState, rate_at, state_of_camera
from meshslam.localization.imu_buffer import ImuBuffer
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples, InitialState


@dataclass(frozen=True, eq=False)
class Frame:
    """One image's detections."""

    number: int
    time_s: float
    detections: Sequence[Detection]


@dataclass
class Stream:
    """Time goes on from frame to frame; the first frame has the state that the start tells."""

    start: InitialState
    imu_from_camera: Pose
    imu: ImuBuffer = field(default_factory=ImuBuffer)
    last_s: float | None = None  # time of the newest frame

    def take(self, frame: Frame, samples: ImuSamples) -> tuple[ImuSamples, NavState | None]:
        """The samples about a new frame, and its state if it is the first; SequenceError if time does not go on."""
        if self.last_s is not None and frame.time_s <= self.last_s:
            raise SequenceError(f"frame {frame.number}: its time {frame.time_s:.6f} s is not after {self.last_s:.6f} s")
        held, is_first = self.imu.add(samples), self.last_s is None
        self.last_s = frame.time_s
        self.imu.forget_before(frame.time_s)
        return held, self._first_state(frame.time_s, held) if is_first else None

    def _first_state(self, time_s: float, held: ImuSamples) -> NavState:
        pose, velocity = self.start.world_from_camera, self.start.velocity_in_world
        return state_of_camera(time_s, pose, velocity, rate_at(held, time_s), self.imu_from_camera)

    def samples_to_save(self) -> ImuSamples:
        """What a saved run needs; SequenceError before the first frame."""
        if self.last_s is None or self.imu.samples is None:
            raise SequenceError("nothing to save: no frame was processed yet")
        return self.imu.samples
