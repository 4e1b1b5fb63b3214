"""A factor graph over a window of time: Gauss-Newton that checks the true cost, and marginalization.

GTSAM's own fixed-lag smoothers evaluate every factor a dozen times an update; factors that the core computes are worth
more care. A step here asks each factor twice, and views that are settled are held as linear factors.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from meshslam.geometry import Floats
from meshslam.graph.marginals import Group, covariances_at_root, joint_covariances, tie

_HALVINGS = 4


@dataclass(eq=False)
class Entry:
    """A factor of the window; `tag` says what it belongs to."""

    factor: gtsam.NonlinearFactor
    keys: frozenset[int]
    tag: object = None
    origin: gtsam.NonlinearFactor | None = None  # the factor before it was settled; None: what variables left behind


def eliminated(linear: gtsam.GaussianFactorGraph, last: Sequence[int] = ()) -> gtsam.GaussianBayesTree:
    """A linear graph's Bayes tree, variables of `last`, where one factor ties them, at the end of its root.

    By Cholesky, in a fifteenth of QR's time; by QR where a pivot is lost to rounding.
    """
    ordering = gtsam.Ordering.ColamdConstrainedLastGaussianFactorGraph(linear, list(last))
    try:
        return linear.eliminateMultifrontal(ordering)
    except RuntimeError:  # GTSAM's IndeterminantLinearSystemException
        return linear.eliminateMultifrontal(ordering, gtsam.EliminateQR)


def linear_factor(
    one: int, by_one: Floats, other: int, by_other: Floats, sigma: float = 1.0
) -> gtsam.LinearContainerFactor:
    """|A x + B y| / sigma over two vectors."""
    origin = gtsam.Values()
    origin.insert(one, np.zeros(by_one.shape[1]))
    origin.insert(other, np.zeros(by_other.shape[1]))
    noise = gtsam.noiseModel.Isotropic.Sigma(len(by_one), sigma)
    linear = gtsam.JacobianFactor(one, by_one, other, by_other, np.zeros(len(by_one)), noise)
    return gtsam.LinearContainerFactor(linear, origin)


def rows_factor(keys: Sequence[tuple[int, int]], rows: Floats, values: gtsam.Values) -> gtsam.LinearContainerFactor:
    """|A x - b| over (key, width) in this order, x being steps from the values; `rows` is [A b]."""
    start, blocks = 0, []
    for _, width in keys:
        blocks.append(np.asfortranarray(rows[:, start : start + width]))
        start += width
    residual = -rows[:, -1]

    def error(_: gtsam.CustomFactor, _values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        if jacobians is not None:
            for i, block in enumerate(blocks):
                jacobians[i] = block
        return residual

    names = [key for key, _ in keys]
    unit = gtsam.noiseModel.Unit.Create(len(rows))
    linear = gtsam.CustomFactor(unit, names, error).linearize(values)
    return gtsam.LinearContainerFactor(linear, values.extract(sorted(names)))


class Window:
    """Variables with their factors; what leaves becomes a linear prior on what stays."""

    def __init__(self) -> None:
        self.values = gtsam.Values()
        self.entries: list[Entry] = []
        self.cost = 0.0
        # the factors as `optimize` linearized them last, and as it eliminated them
        self._linear: gtsam.GaussianFactorGraph | None = None
        self._tree: gtsam.GaussianBayesTree | None = None

    def add(self, factor: gtsam.NonlinearFactor, tag: object = None) -> Entry:
        """Take in a factor."""
        entry = Entry(factor, frozenset(factor.keys()), tag, factor)
        self.entries.append(entry)
        return entry

    def drop(self, entries: Iterable[Entry]) -> None:
        """Forget factors."""
        gone = {id(entry) for entry in entries}
        self.entries = [entry for entry in self.entries if id(entry) not in gone]

    def optimize(self, iterations: int, tolerance: float = 1e-2, last: Sequence[int] = ()) -> None:
        """Gauss-Newton steps, halved until the true cost falls; ends when it falls by less than `tolerance`.

        The joint covariances of variables of `last` cost nothing afterwards.
        """
        graph = self._graph(self.entries)
        self.cost = graph.error(self.values)
        tied = tie(tuple(last), {key: self._width(key) for key in last}) if last else None
        for _ in range(iterations):
            self._linear = graph.linearize(self.values)
            if tied is not None:
                self._linear.push_back(tied)
            self._tree = eliminated(self._linear, last)
            delta = self._tree.optimize()
            before, accepted = self.cost, False
            for _ in range(_HALVINGS):
                trial = self.values.retract(delta)
                cost = graph.error(trial)
                if np.isfinite(cost) and cost <= before:
                    self.values, self.cost, accepted = trial, cost, True
                    break
                delta = delta.scale(0.5)
            if not accepted or before - self.cost < tolerance:
                break

    def joint_covariances(self, groups: Sequence[Group], last: Iterable[int]) -> list[Floats]:
        """Joint covariance of each group of variables, by the factors as `optimize` linearized them last.

        See `marginals.joint_covariances`. No factor is evaluated; what came in since then does not count yet.
        """
        widths = {key: self._width(key) for group in groups for key in group}
        at_root = None if self._tree is None else covariances_at_root(self._tree, groups, self._width)
        if at_root is not None:
            return at_root
        linear = self.linearized() if self._linear is None else self._linear
        return joint_covariances(linear, groups, widths, last)

    def covariance(self, key: int) -> Floats:
        """Covariance of a variable in GTSAM's tangent space."""
        linear = self._graph(self.entries).linearize(self.values)
        ordering = gtsam.Ordering.ColamdConstrainedLastGaussianFactorGraph(linear, [key])
        last = linear.eliminateSequential(ordering, gtsam.EliminateQR).back()
        inverse = np.linalg.pinv(np.asarray(last.R()))
        found: Floats = inverse @ inverse.T
        return found

    def covariances(self, keys: Sequence[int]) -> dict[int, Floats]:
        """As `covariance` of each variable, by one elimination for all of them."""
        if not keys:
            return {}
        linear = self._graph(self.entries).linearize(self.values)
        ordering = gtsam.Ordering.ColamdConstrainedLastGaussianFactorGraph(linear, list(keys))
        net = linear.eliminateSequential(ordering, gtsam.EliminateQR)
        last, wanted = gtsam.GaussianBayesNet(), set(keys)
        for conditional in (net.at(index) for index in range(net.size())):
            if conditional.keys()[0] in wanted:  # its other keys are wanted ones, too: they come last
                last.push_back(conditional)
        inverse = np.linalg.pinv(np.asarray(last.matrix()[0]))
        joint, start, found = inverse @ inverse.T, 0, {}
        for index in range(last.size()):
            key = last.at(index).keys()[0]
            width = self.values.extract([key]).dim()
            found[key] = joint[start : start + width, start : start + width]
            start += width
        return found

    def settle(self, entries: Sequence[Entry]) -> None:
        """Hold factors as they are linearized now."""
        for entry in entries:
            if not isinstance(entry.factor, gtsam.LinearContainerFactor):
                linear = entry.factor.linearize(self.values)
                entry.factor = gtsam.LinearContainerFactor(linear, self._subset(entry.keys))

    def marginalize(self, keys: set[int]) -> list[Entry]:
        """Take variables out; what their factors say of the others stays. Returns the factors that are gone.

        By QR: priors' precisions span 14 decades, Cholesky works on their squares, and what is lost here is lost.
        """
        if not keys:
            return []
        touched = [entry for entry in self.entries if entry.keys & keys]
        self.entries = [entry for entry in self.entries if not entry.keys & keys]
        linear = self._graph(touched).linearize(self.values)
        _, rest = linear.eliminatePartialMultifrontal(sorted(keys), gtsam.EliminateQR)
        for i in range(rest.size()):
            factor = rest.at(i)
            if factor is not None and factor.size():
                held = gtsam.LinearContainerFactor(factor, self._subset(frozenset(factor.keys())))
                self.entries.append(Entry(held, frozenset(factor.keys())))
        for key in keys:
            self.values.erase(key)
        return touched

    def linearized(self) -> gtsam.GaussianFactorGraph:
        """All factors, linearized at the values."""
        return self._graph(self.entries).linearize(self.values)

    def add_rows(self, keys: Sequence[tuple[int, int]], rows: Floats) -> None:
        """Take in |A x - b| over (key, width) in this order, x being steps from the values held; `rows` is [A b]."""
        self.add(rows_factor(keys, rows, self.values))

    def _graph(self, entries: Iterable[Entry]) -> gtsam.NonlinearFactorGraph:
        graph = gtsam.NonlinearFactorGraph()
        for entry in entries:
            graph.add(entry.factor)
        return graph

    def _width(self, key: int) -> int:
        """How many numbers a step of a variable has; 0 if it has left the window."""
        return int(self.values.extract([key]).dim()) if self.values.exists(key) else 0

    def _subset(self, keys: frozenset[int]) -> gtsam.Values:
        return self.values.extract(sorted(keys))
