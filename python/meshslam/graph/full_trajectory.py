"""Full-trajectory smoothing: all variables and factors of a run, those that left the window too."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import gtsam
import numpy as np
from gtsam.symbol_shorthand import O, Z

from meshslam.graph.window import Entry, Window, linear_factor

_JOINED_POSE_SIGMAS = np.array([0.02] * 3 + [0.05] * 3)  # rad, m
_JOINED_MODES_SIGMA = 0.5
_MAX_ERROR = 30.0  # half a squared Mahalanobis distance over 6 + modes, of two objects that are one

Pair = tuple[int, int]


@dataclass
class History:
    """Variables that left the window, at their last estimates, and the factors between them as they were given."""

    values: gtsam.Values = field(default_factory=gtsam.Values)
    entries: list[Entry] = field(default_factory=list)
    _order: list[int] = field(default_factory=list, repr=False)  # of the variables taken since it was made

    def take(self, window: Window, keys: set[int]) -> None:
        """Marginalize variables out of the window, and keep them with their factors."""
        if keys:
            self.values.insert(window.values.extract(sorted(keys)))
            self._order += sorted(keys)
            gone = [entry for entry in window.marginalize(keys) if entry.origin is not None]
            for entry in gone:
                entry.term = None  # smoothing takes the factors as they were given
            self.entries += gone

    def checkpoint(self) -> Callable[[], None]:
        """How to come back to what is held now; it costs the same however long the run is."""
        entries, count, variables = self.entries, len(self.entries), len(self._order)

        def undo() -> None:
            self.entries = entries
            del entries[count:]
            for key in self._order[variables:]:
                self.values.erase(key)
            del self._order[variables:]

        return undo

    def forget(self, number: int) -> None:
        """Drop the observations of an object."""
        self.entries = [e for e in self.entries if getattr(e.tag, "number", None) != number]


def smooth_full_trajectory(
    history: History, window: Window, joined: Sequence[Pair], iterations: int
) -> tuple[Window, tuple[Pair, ...]]:
    """All variables of a run, solved over all of its factors, and which of the pairs of landmarks `joined` are one.

    A pair that the rest speaks against, once all are solved together, is taken back, the worst first.
    """
    everything = Window()
    everything.values.insert(history.values)
    everything.values.insert(window.values)
    for entry in [*history.entries, *window.entries]:
        if entry.origin is not None:
            everything.add(entry.origin, entry.tag, entry.origin_term)
    held = list(joined)
    for pair in held:
        _join(everything, pair)
    everything.optimize(iterations)
    while held and _error(everything, worst := max(held, key=partial(_error, everything))) > _MAX_ERROR:
        held.remove(worst)
        everything.drop([entry for entry in everything.entries if entry.tag == worst])
        everything.optimize(iterations)
    return everything, tuple(held)


def _join(everything: Window, pair: Pair) -> None:
    """Two objects that are one: the same pose and modes."""
    one, other = pair
    noise = gtsam.noiseModel.Diagonal.Sigmas(_JOINED_POSE_SIGMAS)
    everything.add(gtsam.BetweenFactorPose3(O(one), O(other), gtsam.Pose3(), noise), pair)
    unit = np.eye(len(everything.values.atVector(Z(one))))
    everything.add(linear_factor(Z(one), unit, Z(other), -unit, _JOINED_MODES_SIGMA), pair)


def _error(everything: Window, pair: Pair) -> float:
    return sum(entry.factor.error(everything.values) for entry in everything.entries if entry.tag == pair)
