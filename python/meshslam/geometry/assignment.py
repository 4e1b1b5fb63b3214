"""One to one assignment of rows to columns."""

from __future__ import annotations

import math

from meshslam.errors import GeometryError
from meshslam.geometry.arrays import Floats

Costs = list[list[float]]


def best_pairs(scores: Floats) -> list[tuple[int, int]]:
    """Pairs (row, column), rows ascending, whose scores (n, m) add up to the most: each row or each column has one.

    Shortest augmenting paths (Jonker and Volgenant 1987; Crouse 2016). The same scores give the same pairs, also where
    several would be the best. GeometryError for a score that is not finite.

    >>> import numpy as np
    >>> best_pairs(np.array([[0.9, 0.8], [0.7, 0.1], [0.0, 0.0]]))
    [(0, 1), (1, 0)]
    """
    rows, columns = scores.shape
    costs: Costs = (-scores if rows <= columns else -scores.T).tolist()
    if not all(math.isfinite(cost) for row in costs for cost in row):
        raise GeometryError("scores of an assignment are finite numbers")
    if not costs or not costs[0]:
        return []
    columns_of = _assigned(costs)
    if rows <= columns:
        return list(enumerate(columns_of))
    return sorted((column, row) for row, column in enumerate(columns_of))


def _assigned(costs: Costs) -> list[int]:
    """The column of each row at the least cost; there are at least as many columns as rows."""
    count = len(costs[0])
    row_price, column_price = [0.0] * len(costs), [0.0] * count
    column_of, row_of = [-1] * len(costs), [-1] * count
    for start in range(len(costs)):
        came_from, shortest = [-1] * count, [math.inf] * count
        left = list(range(count - 1, -1, -1))  # so that equal costs give each row its own column
        visited, settled = [], []
        row, length, end = start, 0.0, -1
        while end < 0:
            visited.append(row)
            own, price, nearest, at = costs[row], row_price[row], math.inf, -1
            for place, column in enumerate(left):
                cost = length + own[column] - price - column_price[column]
                if cost < shortest[column]:
                    came_from[column], shortest[column] = row, cost
                cost = shortest[column]
                if cost < nearest or (cost == nearest and row_of[column] < 0):
                    nearest, at = cost, place
            length, column = nearest, left[at]
            settled.append(column)
            left[at] = left[-1]
            left.pop()
            if row_of[column] < 0:
                end = column
            else:
                row = row_of[column]
        row_price[start] += length
        for row in visited[1:]:
            row_price[row] += length - shortest[column_of[row]]
        for column in settled:
            column_price[column] -= length - shortest[column]
        column = end
        while True:  # the pairs along the path change partners
            row = came_from[column]
            row_of[column] = row
            column_of[row], column = column, column_of[row]
            if row == start:
                break
    return column_of
