"""Which of many points on the ground are near others: a grid of cells, NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Ints

_STRIDE = np.int64(2**31)  # of a cell's column in its key: cells within 10^9 of the origin have keys of their own


@dataclass(frozen=True, eq=False)
class GroundGrid:
    """Points on the ground, sorted by square cells: `near` finds those about other points without trying all.

    >>> grid = GroundGrid.of(np.array([[0.0, 0.0], [5.0, 0.0]]), 2.0)
    >>> grid.near(np.array([[4.0, 0.0]]))
    (array([0]), array([1]))
    """

    points: Floats  # (n, 2), metres
    radius_m: float
    _order: Ints  # (n,), points by key
    _keys: Ints  # (n,), ascending

    @staticmethod
    def of(points: Floats, radius_m: float) -> GroundGrid:
        """Sort points (n, 2) by cells as large as the radius, metres."""
        keys = _key(_cells(points, radius_m))
        order = np.argsort(keys, kind="stable")
        return GroundGrid(points, radius_m, order, keys[order])

    def near(self, queries: Floats) -> tuple[Ints, Ints]:
        """Indices (k,) of queries (m, 2) and of the points within the radius of each, by query, then by point."""
        cells = _cells(queries, self.radius_m)
        who, found = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for column in (-1, 0, 1):
            # the three cells of a column lie side by side in the order of keys
            first = np.searchsorted(self._keys, _key(cells + np.array([column, -1])), "left")
            last = np.searchsorted(self._keys, _key(cells + np.array([column, 1])), "right")
            query, place = spans(first, last)
            who.append(query)
            found.append(self._order[place])
        query, point = np.concatenate(who), np.concatenate(found)
        within = ((queries[query] - self.points[point]) ** 2).sum(1) <= self.radius_m**2
        query, point = query[within], point[within]
        order = np.lexsort((point, query))
        return query[order], point[order]


def spans(first: Ints, last: Ints) -> tuple[Ints, Ints]:
    """For ranges `first[i]` to below `last[i]`, one after the other: i, and each number of its range.

    >>> spans(np.array([3, 0]), np.array([5, 1]))
    (array([0, 0, 1]), array([3, 4, 0]))
    """
    count = np.maximum(last - first, 0)
    who = np.repeat(np.arange(len(first)), count)
    start = np.cumsum(count) - count
    return who, np.arange(int(count.sum())) - start[who] + first[who]


def _cells(points: Floats, size_m: float) -> Ints:
    found: Ints = np.floor(points / size_m).astype(np.int64)
    return found


def _key(cells: Ints) -> Ints:
    found: Ints = cells[:, 0] * _STRIDE + cells[:, 1]
    return found
