"""Costs by frames and cars, fitted to what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from cluster_simulation import Drives
from cluster_simulation.day import STEPS, drives_of
from scipy.optimize import nnls

STRAGGLERS = 0.25  # sigma of the logarithm of an attempt's time
Row = dict[str, Any]


def fit(rows: Sequence[Row], of: str, by: Sequence[str]) -> dict[str, float]:
    """Least squares without negative parts: what is fixed, and what each frame or car adds; and the rows' spread."""
    terms = np.array([[1.0, *(row[name] for name in by)] for row in rows])
    values = np.array([row[of] for row in rows])
    found, _ = nnls(terms / values[:, None], np.ones(len(values)))  # relative errors
    return dict(zip(("fixed", *by), found.tolist(), strict=True))


def ratios(rows: Sequence[Row], of: str, found: dict[str, float]) -> list[float]:
    """Each row's value over what the fit says."""
    expected = [found["fixed"] + sum(found[name] * row[name] for name in found if name != "fixed") for row in rows]
    return [round(row[of] / one, 3) for row, one in zip(rows, expected, strict=True)]


class Costs:
    """What was measured, as the simulation needs it."""

    def __init__(self, found: dict[str, Any]) -> None:
        self.driver = found["driver"]["figures"]
        steps = [row for row in found["steps"]["figures"]["steps"] if row["image_bytes"] and row["command"] == "map"]
        by_step = {step: [row for row in steps if row["step"] == step] for step in STEPS}
        by = {"detect": ("frames",), "track": ("frames",), "map": ("frames", "cars")}
        self.fits = {step: fit(rows, "cpu_s", by[step]) for step, rows in by_step.items()}
        self.ratios = [r for step, rows in by_step.items() for r in ratios(rows, "cpu_s", self.fits[step])]
        self.reads = {  # how often each step reads every image, if the machine keeps none of them in memory
            step: fit(rows, "read_bytes", ("image_bytes",))["image_bytes"] for step, rows in by_step.items()
        }

    def drives(self, count: int, *, straggler_sigma: float = STRAGGLERS) -> Drives:
        """A day of so many."""
        once = dict.fromkeys(STEPS, 1.0)  # from the storage: the second time, a machine has them in its memory
        return drives_of(count, self.fits, once, self.ratios, straggler_sigma=straggler_sigma)
