"""What left the window: variables where they were last, and the factors between them as they were given."""

from __future__ import annotations

from dataclasses import dataclass, field

import gtsam
import numpy as np
from gtsam.symbol_shorthand import O, Z

from meshslam.localization.window import Entry, Window, linear_factor

_SAME_POSE_SIGMAS = np.array([0.02] * 3 + [0.05] * 3)  # rad, m
_SAME_MODES_SIGMA = 0.5


@dataclass
class Past:
    """All of a run that the window holds no more."""

    values: gtsam.Values = field(default_factory=gtsam.Values)
    entries: list[Entry] = field(default_factory=list)

    def take(self, window: Window, keys: set[int]) -> None:
        """Marginalize variables out of the window, and keep them with their factors."""
        if keys:
            self.values.insert(window.values.extract(sorted(keys)))
            self.entries += [entry for entry in window.marginalize(keys) if entry.origin is not None]


def smooth_whole(past: Past, window: Window, same: list[tuple[int, int]], iterations: int) -> gtsam.Values:
    """All variables of a run, solved over all of its factors; `same` are pairs of objects that are one."""
    whole = Window()
    whole.values.insert(past.values)
    whole.values.insert(window.values)
    entries = past.entries + [entry for entry in window.entries if entry.origin is not None]
    for entry in entries:
        assert entry.origin is not None
        whole.add(entry.origin)
    for one, other in same:
        _join(whole, one, other)
    whole.optimize(iterations)
    return whole.values


def _join(whole: Window, one: int, other: int) -> None:
    """Two objects that are one: the same pose and modes."""
    noise = gtsam.noiseModel
    whole.add(gtsam.BetweenFactorPose3(O(one), O(other), gtsam.Pose3(), noise.Diagonal.Sigmas(_SAME_POSE_SIGMAS)))
    modes = len(whole.values.atVector(Z(one)))
    unit = np.eye(modes)
    whole.add(linear_factor({Z(one): unit, Z(other): -unit}, np.zeros(modes), _SAME_MODES_SIGMA))
