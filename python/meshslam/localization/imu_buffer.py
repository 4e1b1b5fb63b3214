"""IMU samples of a stream, as they come."""

from __future__ import annotations

import numpy as np

from meshslam.sequences import ImuSamples

_KEPT_S = 0.1  # before a frame, for what its successor interpolates


class ImuBuffer:
    """The samples about the newest frame."""

    def __init__(self, samples: ImuSamples | None = None) -> None:
        self.samples = samples

    def add(self, more: ImuSamples) -> ImuSamples:
        """Take in samples, and return all that are held; those that came before are passed over."""
        held = self.samples
        if held is not None:
            new = more.times_s > (held.times_s[-1] if len(held.times_s) else -np.inf)
            more = ImuSamples(
                np.concatenate([held.times_s, more.times_s[new]]),
                np.concatenate([held.angular_rate_rad_s, more.angular_rate_rad_s[new]]),
                np.concatenate([held.specific_force_m_s2, more.specific_force_m_s2[new]]),
            )
        self.samples = more
        return more

    def forget_before(self, time_s: float) -> None:
        """Keep what the next interval, which begins at this time, needs."""
        held = self.samples
        if held is not None:
            keep = held.times_s >= time_s - _KEPT_S
            rates, forces = held.angular_rate_rad_s[keep], held.specific_force_m_s2[keep]
            self.samples = ImuSamples(held.times_s[keep], rates, forces)
