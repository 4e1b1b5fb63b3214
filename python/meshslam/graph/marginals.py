"""Joint covariances of groups of variables, by one elimination for all of them.

The conditionals p(x | S) of the eliminated graph, |R x + A s - d|, are gone through from the last to the first
(Takahashi, Fagan and Chin 1973; Kaess and Dellaert 2009): with G = R^-1 A,

    cov(x, S) = -G cov(S),  cov(x) = (R^T R)^-1 + G cov(S) G^T.

Only blocks that the elimination connects are computed, so the cost grows with the path's length, not with its square.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import gtsam
import numpy as np
from scipy.linalg import solve_triangular

from meshslam.geometry import Floats

Group = tuple[int, ...]


def joint_covariances(
    linear: gtsam.GaussianFactorGraph, groups: Sequence[Group], widths: Mapping[int, int], last: Iterable[int]
) -> list[Floats]:
    """Joint covariance (n, n) of each group of variables, its blocks in the group's order; GTSAM's tangent spaces.

    `widths` are those of the groups' variables. Variables of `last` are eliminated after all others: those that many
    groups share, or all, where there are few groups. RuntimeError if the graph leaves a variable free. By QR: the
    digits that are written must not be rounding's.
    """
    tied = gtsam.GaussianFactorGraph()
    tied.push_back(linear)
    for group in groups:
        tied.push_back(tie(group, widths))
    ordering = gtsam.Ordering.ColamdConstrainedLastGaussianFactorGraph(tied, sorted(set(last)))
    blocks = _Blocks()
    net = tied.eliminateSequential(ordering, gtsam.EliminateQR)
    blocks.fill(net, {key for group in groups for key in group})
    return [blocks.joint(group) for group in groups]


class _Blocks:
    """Covariances of pairs of variables."""

    def __init__(self) -> None:
        self._blocks: dict[tuple[int, int], Floats] = {}

    def fill(self, net: gtsam.GaussianBayesNet, wanted: set[int]) -> None:
        """Go through the conditionals from the last one, until all wanted variables are there."""
        missing = set(wanted)
        for index in range(net.size() - 1, -1, -1):
            conditional = net.at(index)
            key, *parents = conditional.keys()
            self._add(key, parents, np.asarray(conditional.R()), np.asarray(conditional.S()))
            missing.discard(key)
            if not missing:
                return

    def joint(self, keys: Sequence[int]) -> Floats:
        """The joint covariance of variables that the elimination connects."""
        rows = [np.concatenate([self._blocks[one, other] for other in keys], axis=1) for one in keys]
        return np.concatenate(rows)

    def _add(self, key: int, parents: Sequence[int], root: Floats, across: Floats) -> None:
        inverse = solve_triangular(root, np.eye(len(root)), check_finite=False)
        own = inverse @ inverse.T
        if parents:
            gain = inverse @ across
            shared = -gain @ self.joint(parents)
            own = own - shared @ gain.T
            start = 0
            for parent in parents:
                block = shared[:, start : start + len(self._blocks[parent, parent])]
                self._blocks[key, parent], self._blocks[parent, key] = block, block.T
                start += block.shape[1]
        self._blocks[key, key] = 0.5 * (own + own.T)


def tie(group: Group, widths: Mapping[int, int]) -> gtsam.GaussianFactor:
    """A factor that says nothing: with it, the elimination connects a group's variables."""
    values = gtsam.Values()
    for key in group:
        values.insert(key, np.zeros(widths[key]))

    def error(_: gtsam.CustomFactor, _values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        if jacobians is not None:
            for i, key in enumerate(group):
                jacobians[i] = np.zeros((1, widths[key]), order="F")
        return np.zeros(1)

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(1), list(group), error).linearize(values)
