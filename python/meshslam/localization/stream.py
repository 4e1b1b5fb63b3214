"""Bookkeeping of a stream of frames and IMU samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from meshslam.errors import SequenceError
from meshslam.localization.arrivals import (
    JUDGED_S,
    NO_SAMPLES,
    arrived,
    checked_samples,
    checked_time,
    joined,
    units_judged,
)
from meshslam.motion import ImuBuffer
from meshslam.perception import Detection
from meshslam.plausibility import RatesBySight, centres, errors
from meshslam.sequences import ImuSamples

_PATIENCE_S = 3.0  # without any samples, before that is an error


@dataclass
class Stream:
    """Checks what each frame brings before anything is changed, and holds samples as long as they are needed."""

    imu: ImuBuffer = field(default_factory=ImuBuffer)
    last_s: float | None = None  # time of the newest frame
    next_number: int = 0
    source: str = "stream"
    sight: RatesBySight | None = None  # judges the unit of the rates; None: it is right, or not known
    notes: tuple[str, ...] = ()  # of the newest frame
    _first_s: float | None = None
    _unjudged: ImuSamples | None = NO_SAMPLES  # of the first seconds; None: their units are right

    def take(
        self, number: int, time_s: float, imu: ImuSamples | None, *, needs_imu: bool = False, is_live: bool = True
    ) -> None:
        """Add a frame and its samples; unless it is live, those of the whole recording may come with the first frame.

        Samples are sorted; doubled ones count once, broken ones not at all, which `notes` tells. SequenceError, with
        nothing changed, for times that do not go on or jump, for samples that come too late or have another clock or
        unit, and, where an IMU is needed, if none came in the first seconds.
        """
        given = checked_samples(number, imu)
        finite_s = given.times_s[np.isfinite(given.times_s)]
        held_s = self.imu.samples.times_s
        newest = [float(times.max()) for times in (held_s, finite_s) if len(times)]
        now_s = checked_time(number, time_s, self.last_s, max(newest, default=None))
        new = arrived(number, now_s, self.last_s, self.imu.samples, given, is_live=is_live)
        unjudged, said = self._judged(number, new.samples)
        first_s = now_s if self._first_s is None else self._first_s
        if needs_imu and now_s - first_s > _PATIENCE_S and not len(held_s) and not len(new.samples.times_s):
            raise SequenceError(
                f"frame {number}: no IMU samples in the first {now_s - first_s:.1f} s: give each frame the samples "
                "since the last one as imu=…"
            )
        self.imu.add(new.samples)
        self.last_s, self.next_number, self.notes = now_s, number + 1, (*new.notes, *said)
        self._first_s, self._unjudged = first_s, unjudged

    def see(self, number: int, time_s: float, detections: Sequence[Detection]) -> None:
        """Judge the newest samples' rates by what the frame shows; SequenceError if they are in degrees."""
        if self.sight is None:
            return
        self.sight.add(time_s, centres(detections), self.imu.samples)
        if self._first_s is None or time_s - self._first_s <= 1.5 * JUDGED_S[0]:
            return  # g, swapped columns: those are judged first
        for finding in errors(self.sight.findings(f"{self.source}, frame {number}: IMU")):
            raise SequenceError(f"{finding.message}; begin anew with right samples: the poses so far are wrong")
        if self.sight.is_enough:
            self.sight = None

    def checked_number(self, frame: int | None) -> int:
        """The number of the next frame; SequenceError if one is given that does not go on."""
        if frame is None:
            return self.next_number
        if isinstance(frame, bool) or not isinstance(frame, int | np.integer) or frame < 0:
            raise SequenceError(f"frame number {frame!r:.50}, expected an integer from 0")
        if self.last_s is not None and frame < self.next_number:
            raise SequenceError(f"frame {frame}: its number is not after {self.next_number - 1}, the last one's")
        return int(frame)

    def has_samples(self) -> bool:
        """Whether any sample is held."""
        return len(self.imu.samples.times_s) > 0

    def samples(self) -> ImuSamples:
        """All samples that are held."""
        return self.imu.samples

    def forget_before(self, time_s: float) -> None:
        """Keep what the interval needs that begins at this time."""
        self.imu.forget_before(time_s)

    def restore(self, samples: ImuSamples, last_s: float, next_number: int) -> None:
        """Go on from samples that were saved."""
        self.imu, self.last_s, self.next_number = ImuBuffer(samples), last_s, next_number
        self._first_s, self.sight = last_s, None

    def _judged(self, number: int, new: ImuSamples) -> tuple[ImuSamples | None, tuple[str, ...]]:
        """The samples that are still to be judged with those of the next frames."""
        if self._unjudged is None:
            return None, ()
        recent = joined(self._unjudged, new)
        enough, notes = units_judged(number, recent, self.source)
        return None if enough else recent, notes
