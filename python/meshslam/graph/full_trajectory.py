"""Full-trajectory smoothing: all variables and factors of a run, those that left the window too."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial

import gtsam
import numpy as np
from gtsam.symbol_shorthand import O, Z

from meshslam.geometry import Pose
from meshslam.graph.terms import Term
from meshslam.graph.view_terms import ViewTerm, view_factor
from meshslam.graph.window import Entry, Window, linear_factor
from meshslam.motion import from_pose3

_JOINED_POSE_SIGMAS = np.array([0.02] * 3 + [0.05] * 3)  # rad, m
_JOINED_MODES_SIGMA = 0.5
_ROUGH, _FINE = 100.0, 1e-2  # a smaller fall of the cost ends the search: cameras then move by centimetres, or by none
_MAX_ERROR = 30.0  # half a squared Mahalanobis distance over 6 + modes, of two objects that are one

Pair = tuple[int, int]
FindPairs = Callable[[Mapping[int, Pose], Sequence[Pair]], Sequence[Pair]]  # from world_from_object, and what is joined


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
            for entry in window.marginalize(keys):
                if entry.origin is not None:  # smoothing takes the factors as they were given
                    entry.factor, entry.term, entry.linearized = entry.origin, None, None
                    self.entries.append(entry)

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
    history: History,
    window: Window,
    joined: Sequence[Pair],
    iterations: int,
    find_more: FindPairs | None = None,
) -> tuple[Window, tuple[Pair, ...]]:
    """All variables of a run, solved over all of its factors, and which of the pairs of landmarks are one.

    Pairs are those of `joined`, and what `find_more` finds once all are solved together. A pair that the rest then
    speaks against is taken back, the worst first.
    """
    everything = Window()
    everything.values.insert(history.values)
    everything.values.insert(window.values)
    for entry in [*history.entries, *window.entries]:
        if entry.origin is not None:
            factor, term = _own(entry.origin, entry.origin_term)
            everything.add(factor, entry.tag, term)
    held = _solve_joined(everything, joined, iterations, _ROUGH)
    found = [] if find_more is None else find_more(_objects(everything.values), held)
    return everything, tuple(_solve_joined(everything, found, iterations, _FINE, held))


def _own(factor: gtsam.NonlinearFactor, term: Term | None) -> tuple[gtsam.NonlinearFactor, Term | None]:
    """A factor that may be evaluated elsewhere: an observation is then linearized there, and the run's stays."""
    if not isinstance(term, ViewTerm) or term.cost.view is None:
        return factor, term
    own = replace(term, cost=copy(term.cost))
    return view_factor(own), own


def _solve_joined(
    everything: Window, pairs: Sequence[Pair], iterations: int, tolerance: float, before: Sequence[Pair] = ()
) -> list[Pair]:
    """Solve with more pairs; returns those that hold. Pairs that were joined `before` may be taken back, too."""
    for pair in pairs:
        _join(everything, pair)
    held = [*before, *pairs]
    everything.optimize(iterations, tolerance)
    while held and _error(everything, worst := max(held, key=partial(_error, everything))) > _MAX_ERROR:
        held.remove(worst)
        everything.drop([entry for entry in everything.entries if entry.tag == worst])
        everything.optimize(iterations, tolerance)
    return held


def _objects(values: gtsam.Values) -> dict[int, Pose]:
    """world_from_object of all landmarks, by number."""
    numbers = [gtsam.Symbol(k).index() for k in values.keys() if chr(k >> 56) == "o"]  # noqa: SIM118 # no mapping
    return {number: from_pose3(values.atPose3(O(number))) for number in numbers}


def _join(everything: Window, pair: Pair) -> None:
    """Two objects that are one: the same pose and modes."""
    one, other = pair
    noise = gtsam.noiseModel.Diagonal.Sigmas(_JOINED_POSE_SIGMAS)
    everything.add(gtsam.BetweenFactorPose3(O(one), O(other), gtsam.Pose3(), noise), pair)
    unit = np.eye(len(everything.values.atVector(Z(one))))
    everything.add(linear_factor(Z(one), unit, Z(other), -unit, _JOINED_MODES_SIGMA), pair)


def _error(everything: Window, pair: Pair) -> float:
    return sum(entry.factor.error(everything.values) for entry in everything.entries if entry.tag == pair)
