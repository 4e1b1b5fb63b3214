"""Parked objects of a map seen from above, and where in it a handful of objects may lie."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from meshslam import _core
from meshslam.geometry.arrays import Floats


class ParkedRules(NamedTuple):
    """What is assumed of two sets of parked objects."""

    place_variance_m2: float  # of two places together, beside the objects' own
    drift_share: float  # sigma that a place gains for each metre from the others
    heading_sigma_rad: float
    size_variance: float  # of the difference of one object's logarithmic sizes
    other_size_variance: float  # likewise of two objects
    objects_per_m2: float  # by chance
    gate: float  # sigmas beyond which nothing is the same object
    scale_sigma: float = 0.0  # of the scale of the handful's world, about 1; 0 where it is known


def parked_rows(places_m: Floats, yaws_rad: Floats, sizes_m: Floats, sigmas_m: Floats) -> Floats:
    """Rows (n, 7) of objects at places (n, 2 or 3), with length, width, height (n, 3) and the place's sigma (n,)."""
    sizes = np.log(np.maximum(sizes_m, 1e-3))
    return np.column_stack([places_m[:, :2], yaws_rad, sizes, np.square(sigmas_m)]).astype(float)


class ParkedMap:
    """Objects of a map on a grid of the ground; ValueError for rows that are not finite.

    Example:
        found = ParkedMap(parked_rows(*known)).candidates(parked_rows(*seen), [(0, 1)], [pairs], rules, 10)
        score, yaw_rad, x_m, y_m, scale = found[0]

    """

    def __init__(self, objects: Floats) -> None:
        """`objects`: as `parked_rows` makes them."""
        self._native = _core.ParkedMap(np.ascontiguousarray(objects, float))

    def candidates(
        self, seen: Floats, ends: Sequence[tuple[int, int]], pairs: Sequence[Any], rules: ParkedRules, keep: int
    ) -> Floats:
        """The best places of `seen` (m, 7), at most `keep`: rows (k, 5) of score, turn about z (rad), shift (m), scale.

        `ends[q]` is a pair of `seen`; it is laid on each of the map's pairs `pairs[q]` (p, 2), int32, either way round.
        IndexError for objects that there are not, ValueError for arrays of other shapes.
        """
        rows = [np.ascontiguousarray(of, np.int32) for of in pairs]
        return self._native.candidates(np.ascontiguousarray(seen, float), list(ends), rows, rules, keep)
