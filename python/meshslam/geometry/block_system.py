"""Linear factors of a graph's variables, and the normal equations of many factors; the core computes them.

Variables have numbers, 0 and more. A step of a pose is the logarithm of SE(3), here (rotation, translation) as in the
graph; that of a rotation is the logarithm of SO(3), that of a vector a difference.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshslam import _core
from meshslam.geometry.arrays import Floats
from meshslam.geometry.native import floats, geometry_errors, ints

VariableGroup = tuple[Sequence[int], Floats]  # numbers (n,), a row of values for each (n, w)


def _names(numbers: object) -> np.ndarray[tuple[int, ...], np.dtype[np.uint64]]:
    return np.asarray(numbers, np.uint64)


def _plain(group: VariableGroup) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.uint64]], Floats]:
    return _names(group[0]), floats(group[1])


class Variables:
    """Values of some variables: poses, rotations and vectors, each with its key."""

    __slots__ = ("native",)

    def __init__(self, poses: VariableGroup, rotations: VariableGroup, vectors: Sequence[VariableGroup]) -> None:
        """A pose's row is its rotation (9), row by row, and its translation (3), metres; a rotation's is that of 9.

        GeometryError for other shapes, values that are not finite, or a number that two variables have.
        """
        with geometry_errors():
            self.native = _core.Variables(_plain(poses), _plain(rotations), [_plain(group) for group in vectors])


class LinearFactor:
    """0.5 |A x - b|^2, x being steps of some variables from the values at which the factor was linearized."""

    __slots__ = ("native",)

    def __init__(self, numbers: Sequence[int], at: Variables, rows: Floats) -> None:
        """`rows` (m, n + 1) is [A b], its columns those of the variables in the order of `numbers`.

        `at` holds the variables' values, and others if need be. GeometryError for a variable that it does not hold,
        another shape, or a value that is not finite.
        """
        with geometry_errors():
            self.native = _core.LinearFactor(_names(numbers), at.native, floats(rows))


def linear_cost(factors: Sequence[LinearFactor], variables: Variables) -> float:
    """The sum of the factors' costs at these values; GeometryError for a variable that is not there."""
    with geometry_errors():
        return _core.linear_cost([factor.native for factor in factors], variables.native)


class Solution:
    """The step that the normal equations ask for."""

    __slots__ = ("_native", "step")

    def __init__(self, native: _core.Solution) -> None:
        """Made by `BlockSystem.solve`."""
        self._native = native
        self.step = native.step  # (n,), of all variables in the ascending order of their numbers

    def covariance(self, numbers: Sequence[int]) -> Floats | None:
        """Joint covariance (n, n) of variables that were eliminated last; None where one of them was not."""
        with geometry_errors():
            return self._native.covariance(_names(numbers))


class BlockSystem:
    """The sum of many factors 0.5 |A x - b|^2 over steps of variables, solved block by block (Cholesky)."""

    def __init__(self, widths: dict[int, int], blocks: Sequence[int] | None = None) -> None:
        """`widths` says how many numbers a step of each variable has.

        Variables of the same number in `blocks`, in the order of `widths`, are eliminated together, as one dense block.
        """
        names = _names(list(widths))
        with geometry_errors():
            sizes = ints(np.array(list(widths.values()), np.int64))
            self._native = _core.BlockSystem(names, sizes, names if blocks is None else _names(blocks))

    def add_linear(self, factors: Sequence[LinearFactor], variables: Variables) -> None:
        """Add linear factors, at these values; GeometryError for a variable that is not there."""
        with geometry_errors():
            self._native.add_linear([factor.native for factor in factors], variables.native)

    def add_rows(self, numbers: Sequence[int], rows: Floats) -> None:
        """Add 0.5 |A x - b|^2; `rows` (m, n + 1) is [A b], its columns those of the variables in this order.

        GeometryError for a variable that is not there, another shape, or a value that is not finite.
        """
        with geometry_errors():
            self._native.add_rows(_names(numbers), floats(rows))

    def add_all_rows(self, numbers: Sequence[Sequence[int]], rows: Floats) -> None:
        """As `add_rows` for k factors of one shape: `rows` (k, m, n + 1)."""
        with geometry_errors():
            self._native.add_all_rows(_names(numbers), floats(rows))

    def add_information(self, numbers: Sequence[int], hessian: Floats, gradient: Floats) -> None:
        """Add 0.5 x^T H x + g^T x, H (n, n) and g (n,); errors as of `add_rows`."""
        with geometry_errors():
            self._native.add_information(_names(numbers), floats(hessian), floats(gradient))

    def solve(self, last: Sequence[int] = ()) -> Solution:
        """The best step; variables of `last` are eliminated last, so that their covariance costs nothing.

        GeometryError if nothing holds a variable, or what holds it is lost to rounding.
        """
        with geometry_errors():
            return Solution(self._native.solve(_names(last)))

    def covariances(self, groups: Sequence[Sequence[int]], last: Sequence[int] = ()) -> list[Floats]:
        """Joint covariance (n, n) of each group of variables, its blocks in the group's order, by one elimination.

        Variables of `last`, which many groups share, are eliminated last. Only covariances of variables that the
        elimination connects are computed (Takahashi, Fagan and Chin 1973). Errors as of `solve`.
        """
        with geometry_errors():
            return self._native.covariances([_names(group) for group in groups], _names(last))
