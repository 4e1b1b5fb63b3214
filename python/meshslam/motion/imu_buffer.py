"""The newest IMU samples of a stream."""

from __future__ import annotations

import numpy as np

from meshslam.sequences import ImuSamples

_KEPT_S = 2.0  # before a frame: what its successor interpolates, and enough to tell a gap from the usual period


class ImuBuffer:
    """The samples about the newest frames."""

    def __init__(self, samples: ImuSamples | None = None) -> None:
        self.samples = ImuSamples(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))) if samples is None else samples

    def add(self, more: ImuSamples) -> ImuSamples:
        """Add samples, and return all that are held; samples older than the newest held one are ignored."""
        held = self.samples
        if not len(held.times_s):
            self.samples = more
            return more
        new = more.times_s > held.times_s[-1]
        self.samples = ImuSamples(
            np.concatenate([held.times_s, more.times_s[new]]),
            np.concatenate([held.angular_rate_rad_s, more.angular_rate_rad_s[new]]),
            np.concatenate([held.specific_force_m_s2, more.specific_force_m_s2[new]]),
        )
        return self.samples

    def forget_before(self, time_s: float) -> None:
        """Keep what the next interval, which begins at this time, needs."""
        held = self.samples
        keep = held.times_s >= time_s - _KEPT_S
        rates, forces = held.angular_rate_rad_s[keep], held.specific_force_m_s2[keep]
        self.samples = ImuSamples(held.times_s[keep], rates, forces)
