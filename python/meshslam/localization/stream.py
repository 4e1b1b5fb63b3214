"""Bookkeeping of a stream of frames and IMU samples."""

from __future__ import annotations

from dataclasses import dataclass, field

from meshslam.errors import SequenceError
from meshslam.motion import ImuBuffer
from meshslam.sequences import ImuSamples


@dataclass
class Stream:
    """Checks that times increase from frame to frame, and holds samples as long as they are needed."""

    imu: ImuBuffer = field(default_factory=ImuBuffer)
    last_s: float | None = None  # time of the newest frame
    next_number: int = 0

    def take(self, number: int, time_s: float, samples: ImuSamples) -> None:
        """Add a frame and its samples; SequenceError if its time is not after the last one's."""
        if self.last_s is not None and not time_s > self.last_s:
            raise SequenceError(f"frame {number}: its time {time_s:.6f} s is not after {self.last_s:.6f} s")
        self.imu.add(samples)
        self.last_s, self.next_number = time_s, number + 1

    def samples(self) -> ImuSamples:
        """All samples that are held."""
        return self.imu.samples

    def forget_before(self, time_s: float) -> None:
        """Keep what the interval needs that begins at this time."""
        self.imu.forget_before(time_s)

    def restore(self, samples: ImuSamples, last_s: float, next_number: int) -> None:
        """Go on from samples that were saved."""
        self.imu, self.last_s, self.next_number = ImuBuffer(samples), last_s, next_number
