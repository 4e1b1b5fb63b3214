"""One to one assignment of rows to columns."""

from __future__ import annotations

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry.arrays import Floats


def best_pairs(scores: Floats) -> list[tuple[int, int]]:
    """Pairs (row, column), rows ascending, whose scores (n, m) add up to the most: each row or each column has one.

    SciPy's linear_sum_assignment (Crouse 2016). The same scores give the same pairs, also where several would be the
    best. GeometryError for a score that is not finite.

    >>> import numpy as np
    >>> best_pairs(np.array([[0.9, 0.8], [0.7, 0.1], [0.0, 0.0]]))
    [(0, 1), (1, 0)]
    """
    from scipy.optimize import linear_sum_assignment

    if not np.isfinite(scores).all():
        raise GeometryError("scores of an assignment are finite numbers")
    rows, columns = linear_sum_assignment(scores, maximize=True)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))
