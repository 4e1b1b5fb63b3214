"""Factors of a window in a form in which many of them are evaluated at once, beside GTSAM's.

Each group's cost is the sum of its factors' errors; its normal equations are theirs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import gtsam
import numpy as np

from meshslam.geometry import BlockSystem, Floats, LinearFactor, NormalEquations, VariableGroup, Variables, linear_cost
from meshslam.graph.point_factor import PointTerm
from meshslam.graph.view_terms import ViewTerm, ViewTerms

Term = LinearFactor | PointTerm | ViewTerm

_POSES = "xo"  # kinds of variables, by the first letter of their key
_VECTORS = "vtsz"
_BLOCKS = {"v": "x", "b": "x", "z": "o"}  # kinds whose variables are eliminated with those of another kind
_MANY = 8  # poses


def variables_of(values: gtsam.Values, keys: Iterable[int]) -> Variables:
    """Some variables' values, as the core takes them."""
    kinds: dict[str, list[int]] = {}
    for key in sorted(keys):
        kinds.setdefault(chr(key >> 56), []).append(key)
    poses = [key for kind in sorted(_POSES) for key in kinds.get(kind, ())]
    turns = kinds.get("e", [])
    turn_rows = np.array([values.atRot3(key).matrix() for key in turns]).reshape(-1, 9)
    groups: list[VariableGroup] = [
        (found, np.array([values.atVector(key) for key in found])) for kind in _VECTORS if (found := kinds.get(kind))
    ]
    if biases := kinds.get("b"):
        groups.append((biases, np.array([values.atConstantBias(key).vector() for key in biases])))
    return Variables((poses, _pose_rows(values, poses)), (turns, turn_rows), groups)


def _pose_rows(values: gtsam.Values, keys: Sequence[int]) -> Floats:
    """Rotation, row by row, and translation of some poses (n, 12); many are read at once."""
    if len(keys) > _MANY:
        every = [key for key in values.keys() if chr(key >> 56) in _POSES]  # noqa: SIM118 # no mapping
        found: Floats = gtsam.utilities.extractPose3(values)[np.searchsorted(every, keys)]
        return found
    matrices = np.array([values.atPose3(key).matrix()[:3] for key in keys]).reshape(-1, 3, 4)
    return np.concatenate([matrices[:, :, :3].reshape(-1, 9), matrices[:, :, 3]], axis=1)


class WindowFactors:
    """All factors of a window."""

    def __init__(self, factors: Iterable[tuple[gtsam.NonlinearFactor, Term | None]]) -> None:
        """GTSAM evaluates a factor that has no term."""
        self._others = gtsam.NonlinearFactorGraph()
        self._linear: list[LinearFactor] = []
        self._points: list[PointTerm] = []
        views: list[ViewTerm] = []
        names: set[int] = set()
        for factor, term in factors:
            if term is None:
                self._others.add(factor)
            elif isinstance(term, LinearFactor):
                self._linear.append(term)
                names.update(factor.keys())
            elif isinstance(term, PointTerm):
                self._points.append(term)
            else:
                views.append(term)
        self._views, self._linear_names = ViewTerms(views), sorted(names)
        self._at: tuple[gtsam.Values, Variables] | None = None
        self._points_at: tuple[gtsam.Values, list[NormalEquations]] | None = None

    def cost(self, values: gtsam.Values) -> float:
        """Half the sum of the squares, robust ones weighed."""
        cost = self._others.error(values) + self._views.cost(values)
        cost += sum(equations.cost for equations in self._point_equations(values))
        if self._linear:
            cost += linear_cost(self._linear, self._variables(values))
        return float(cost)

    def system(self, values: gtsam.Values, widths: dict[int, int]) -> BlockSystem:
        """The normal equations at these values; `widths` are those of all variables."""
        system = BlockSystem(widths, [_block_of(key) for key in widths])
        _add_all(system, self._others.linearize(values))
        self._views.add_to(system, values)
        for term, equations in zip(self._points, self._point_equations(values), strict=True):
            system.add_information(*term.information(values, equations))
        if self._linear:
            system.add_linear(self._linear, self._variables(values))
        return system

    def _point_equations(self, values: gtsam.Values) -> list[NormalEquations]:
        """Those of the point tracks: they cost little more than their cost, and a system is asked for where it was."""
        if self._points_at is None or self._points_at[0] is not values:
            self._points_at = values, [term.equations(values) for term in self._points]
        return self._points_at[1]

    def _variables(self, values: gtsam.Values) -> Variables:
        """Those of the linear factors."""
        if self._at is None or self._at[0] is not values:
            self._at = values, variables_of(values, self._linear_names)
        return self._at[1]


def _block_of(key: int) -> int:
    """What a variable is eliminated with: all of a frame together, and all of an object."""
    kind = chr(key >> 56)
    return key ^ ((ord(kind) ^ ord(_BLOCKS.get(kind, kind))) << 56)


def _add_all(system: BlockSystem, linear: gtsam.GaussianFactorGraph) -> None:
    """Add GTSAM's linear factors, those of one shape together."""
    shapes: dict[tuple[int, ...], tuple[list[list[int]], list[Floats]]] = {}
    for factor in (linear.at(i) for i in range(linear.size())):
        if isinstance(factor, gtsam.JacobianFactor):
            keys, rows = factor.keys(), factor.augmentedJacobian()
            names, blocks = shapes.setdefault((len(keys), *rows.shape), ([], []))
            names.append(keys)
            blocks.append(rows)
        elif factor is not None:  # a robust factor may say nothing
            whole = np.asarray(factor.augmentedInformation())
            system.add_information(factor.keys(), whole[:-1, :-1], -whole[:-1, -1])
    for names, blocks in shapes.values():
        system.add_all_rows(names, np.array(blocks))


def vector_values(keys: Sequence[int], widths: dict[int, int], step: Floats) -> gtsam.VectorValues:
    """A step, its parts in the order of `keys`, as GTSAM takes it."""
    found, start = gtsam.VectorValues(), 0
    for key in keys:
        found.insert(key, step[start : start + widths[key]])
        start += widths[key]
    return found
