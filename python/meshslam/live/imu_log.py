"""IMU samples as they come, for threads that wait for them."""

from __future__ import annotations

import threading

import numpy as np

from meshslam.plausibility import wild_samples
from meshslam.sequences import ImuSamples

_CHUNK = 4096  # samples a block
_COLUMNS = 7


class ImuLog:
    """All samples of a run in the order of their times: 56 bytes each. Every method may be called by any thread."""

    def __init__(self) -> None:
        self._rows = np.empty((_CHUNK, _COLUMNS))
        self._count = 0
        self._news = threading.Condition()

    def add(self, samples: ImuSamples) -> int:
        """Take samples in, in any order; returns how many are left out: no numbers, wild ones, and times once more."""
        rows = np.column_stack([samples.times_s, samples.angular_rate_rad_s, samples.specific_force_m_s2])
        rows = rows[np.isfinite(rows).all(1) & ~wild_samples(samples)]
        with self._news:
            held = self._rows[: self._count]
            begin = int(np.searchsorted(held[:, 0], rows[:, 0].min())) if len(rows) else self._count
            tail = np.concatenate([held[begin:], rows])
            tail = tail[np.unique(tail[:, 0], return_index=True)[1]]
            left_out = len(samples.times_s) - (begin + len(tail) - self._count)
            needed = begin + len(tail)
            if needed > len(self._rows):
                grown = np.empty((max(2 * len(self._rows), needed), _COLUMNS))
                grown[:begin] = held[:begin]
                self._rows = grown
            self._rows[begin:needed] = tail
            self._count = needed
            self._news.notify_all()
        return left_out

    def wait_for(self, time_s: float, patience_s: float) -> bool:
        """Wait until the samples reach a time, seconds on their clock; False if they did not in `patience_s`."""
        with self._news:
            return self._news.wait_for(lambda: self._newest_s() >= time_s, patience_s)

    def between(self, after_s: float, until_s: float) -> ImuSamples:
        """The samples with after_s < time <= until_s."""
        with self._news:
            times = self._rows[: self._count, 0]
            first, last = np.searchsorted(times, [after_s, until_s], side="right")
            rows = self._rows[first:last].copy()
        return ImuSamples(rows[:, 0], rows[:, 1:4], rows[:, 4:7])

    def newest(self, count: int) -> ImuSamples:
        """The newest samples, so many at most."""
        with self._news:
            rows = self._rows[max(0, self._count - count) : self._count].copy()
        return ImuSamples(rows[:, 0], rows[:, 1:4], rows[:, 4:7])

    def _newest_s(self) -> float:
        return float(self._rows[self._count - 1, 0]) if self._count else -np.inf
