"""A factor graph over a window of time: Gauss-Newton that checks the true cost, and marginalization.

GTSAM's own fixed-lag smoothers evaluate every factor a dozen times an update; factors that the core computes are worth
more care. A step here asks each factor twice, views that are settled are held as linear factors, and the normal
equations are solved in the core. GTSAM evaluates the rest, marginalizes, and solves by QR what Cholesky cannot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import Floats, LinearFactor, Solution
from meshslam.graph.marginals import Group, joint_covariances
from meshslam.graph.records import Record
from meshslam.graph.terms import Term, WindowFactors, variables_of, vector_values

_HALVINGS = 4


@dataclass(frozen=True, eq=False)
class Linearized:
    """|A x - b|, x being steps of some variables from values."""

    keys: tuple[int, ...]  # in the order of A's columns
    rows: Floats  # [A b]
    at: gtsam.Values

    def factor(self) -> gtsam.LinearContainerFactor:
        """The same as one of GTSAM's factors."""
        widths = [self.at.extract([key]).dim() for key in self.keys]
        return rows_factor(list(zip(self.keys, widths, strict=True)), self.rows, self.at)

    def term(self) -> LinearFactor:
        """The same as the core's."""
        return LinearFactor(self.keys, variables_of(self.at, self.keys), self.rows)


@dataclass(eq=False)
class Entry:
    """A factor of the window; `tag` says what it belongs to, its term is the same where many are evaluated at once."""

    factor: gtsam.NonlinearFactor
    keys: frozenset[int]
    tag: object = None
    origin: gtsam.NonlinearFactor | None = None  # the factor before it was settled; None: what variables left behind
    term: Term | None = None
    origin_term: Term | None = None
    record: Record | None = None  # what the factor was made of, if it is neither an observation nor point tracks
    linearized: Linearized | None = None  # what is held in its place


def eliminated(linear: gtsam.GaussianFactorGraph) -> gtsam.GaussianBayesTree:
    """A linear graph's Bayes tree by QR, which takes fifteen times as long as Cholesky, and loses no pivot."""
    ordering = gtsam.Ordering.ColamdGaussianFactorGraph(linear)
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
        # what `optimize` found when it linearized all factors last
        self._solution: Solution | None = None

    def checkpoint(self) -> Callable[[], None]:
        """How to come back to what is held now.

        Entries change by being settled, their observations by being linearized.
        """
        attributes, entries, values = dict(vars(self)), list(self.entries), gtsam.Values(self.values)
        factors = [(entry, entry.factor, entry.term, entry.linearized) for entry in entries]
        costs = [cost for entry in entries if (cost := getattr(entry.tag, "cost", None)) is not None]
        observed = [(vars(cost), dict(vars(cost))) for cost in costs]

        def undo() -> None:
            vars(self).update(attributes)
            self.entries[:] = entries
            self.values.clear()
            self.values.insert(values)
            for entry, factor, term, linearized in factors:
                entry.factor, entry.term, entry.linearized = factor, term, linearized
            for fields, held in observed:
                fields.update(held)

        return undo

    def add(
        self,
        factor: gtsam.NonlinearFactor,
        tag: object = None,
        term: Term | None = None,
        record: Record | None = None,
    ) -> Entry:
        """Take in a factor."""
        entry = Entry(factor, frozenset(factor.keys()), tag, factor, term, term, record)
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
        factors = WindowFactors((entry.factor, entry.term) for entry in self.entries)
        widths = {key: self._width(key) for key in sorted(self.values.keys())}
        self.cost = factors.cost(self.values)
        for _ in range(iterations):
            delta = self._step(factors, widths, last)
            before, accepted = self.cost, False
            for _ in range(_HALVINGS):
                trial = self.values.retract(delta)
                cost = factors.cost(trial)
                if np.isfinite(cost) and cost <= before:
                    self.values, self.cost, accepted = trial, cost, True
                    break
                delta = delta.scale(0.5)
            if not accepted or before - self.cost < tolerance:
                break

    def _step(self, factors: WindowFactors, widths: dict[int, int], last: Sequence[int]) -> gtsam.VectorValues:
        """The Gauss-Newton step at the values: by Cholesky in the core, by QR where a pivot is lost to rounding."""
        self._solution = None
        system = factors.system(self.values, widths)
        try:
            self._solution = system.solve(last)
        except GeometryError:
            return eliminated(self.linearized()).optimize()
        return vector_values(list(widths), widths, self._solution.step)

    def joint_covariances(self, groups: Sequence[Group], last: Iterable[int]) -> list[Floats]:
        """Joint covariance of each group of variables, see `marginals.joint_covariances`.

        Where `optimize` was told that all are to be last, by the factors as it linearized them last: no factor is
        evaluated, and what came in since then does not count yet. Else all are linearized at the values.
        """
        if self._solution is not None:
            found = [self._solution.covariance(group) for group in groups]
            if all(covariance is not None for covariance in found):
                return [covariance for covariance in found if covariance is not None]
        widths = {key: self._width(key) for group in groups for key in group}
        return joint_covariances(self.linearized(), groups, widths, last)

    def path_covariances(self, groups: Sequence[Group], last: Sequence[int]) -> list[Floats]:
        """As `joint_covariances` of many groups at the values, at a small part of the cost, to seven digits.

        By Cholesky in the core; by QR where a pivot is lost to rounding.
        """
        factors = WindowFactors((entry.factor, entry.term) for entry in self.entries)
        system = factors.system(self.values, {key: self._width(key) for key in sorted(self.values.keys())})
        try:
            return system.covariances(groups, last)
        except GeometryError:
            widths = {key: self._width(key) for group in groups for key in group}
            return joint_covariances(self.linearized(), groups, widths, last)

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
                entry.factor, entry.term, entry.linearized = self._held(entry.factor.linearize(self.values))

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
                held, term, linearized = self._held(factor)
                self.entries.append(Entry(held, frozenset(factor.keys()), term=term, linearized=linearized))
        for key in keys:
            self.values.erase(key)
        return touched

    def linearized(self) -> gtsam.GaussianFactorGraph:
        """All factors, linearized at the values."""
        return self._graph(self.entries).linearize(self.values)

    def add_rows(self, keys: Sequence[tuple[int, int]], rows: Floats) -> None:
        """Take in |A x - b| over (key, width) in this order, x being steps from the values held; `rows` is [A b]."""
        self.add(rows_factor(keys, rows, self.values))

    def _held(self, linear: gtsam.GaussianFactor) -> tuple[gtsam.LinearContainerFactor, LinearFactor, Linearized]:
        """A linear factor about the values, for GTSAM, for the core, and as plain numbers."""
        keys = tuple(linear.keys())
        plain = Linearized(keys, np.asarray(linear.augmentedJacobian()), self._subset(frozenset(keys)))
        return gtsam.LinearContainerFactor(linear, plain.at), plain.term(), plain

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
