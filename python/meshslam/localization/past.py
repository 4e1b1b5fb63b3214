"""What left the window: variables where they were last, and the factors between them as they were given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import gtsam
import numpy as np
from gtsam.symbol_shorthand import O, Z

from meshslam.localization.window import Entry, Window, linear_factor

_SAME_POSE_SIGMAS = np.array([0.02] * 3 + [0.05] * 3)  # rad, m
_SAME_MODES_SIGMA = 0.5
_LARGEST_ERROR = 30.0  # half a squared Mahalanobis distance over 6 + modes, of two objects that are one

Pair = tuple[int, int]


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

    def forget(self, number: int) -> None:
        """Drop what was seen of an object."""
        self.entries = [e for e in self.entries if getattr(e.tag, "number", None) != number]


def smooth_whole(
    past: Past, window: Window, same: Sequence[Pair], iterations: int
) -> tuple[gtsam.Values, tuple[Pair, ...]]:
    """All variables of a run, solved over all of its factors, and which of the pairs of objects `same` are one.

    A pair that the rest speaks against, once all are solved together, is taken back, the worst first.
    """
    whole = Window()
    whole.values.insert(past.values)
    whole.values.insert(window.values)
    for entry in [*past.entries, *window.entries]:
        if entry.origin is not None:
            whole.add(entry.origin)
    held = list(same)
    for pair in held:
        _join(whole, pair)
    whole.optimize(iterations)
    while held and _error(whole, worst := max(held, key=partial(_error, whole))) > _LARGEST_ERROR:
        held.remove(worst)
        whole.drop([entry for entry in whole.entries if entry.tag == worst])
        whole.optimize(iterations)
    return whole.values, tuple(held)


def _join(whole: Window, pair: Pair) -> None:
    """Two objects that are one: the same pose and modes."""
    one, other = pair
    noise = gtsam.noiseModel.Diagonal.Sigmas(_SAME_POSE_SIGMAS)
    whole.add(gtsam.BetweenFactorPose3(O(one), O(other), gtsam.Pose3(), noise), pair)
    unit = np.eye(len(whole.values.atVector(Z(one))))
    whole.add(linear_factor(Z(one), unit, Z(other), -unit, _SAME_MODES_SIGMA), pair)


def _error(whole: Window, pair: Pair) -> float:
    return sum(entry.factor.error(whole.values) for entry in whole.entries if entry.tag == pair)
