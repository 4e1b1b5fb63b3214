"""A day's drives from measured costs: docs/scale.json in, tasks and the driver's costs out."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from math import log
from typing import Any

from .simulated_ray import DriverCosts
from .tasks import Drives, Task

STEPS = ("detect", "track", "map")
MEDIAN_FRAMES, FRAMES_SIGMA = 1101, 0.5  # of a drive: KITTI 06 is the median, lengths are log-normal
CARS_A_FRAME = 91 / 1101  # as drawn along KITTI 06
IMAGE_BYTES = 725e3  # of KITTI's colour frames, PNG
Fit = Mapping[str, float]


def tasks_of(frames: int, fits: Mapping[str, Fit], reads: Mapping[str, float]) -> dict[str, Task]:
    """The steps of `map` for a drive of so many frames."""
    return {
        step: Task(
            expected(fits[step], frames, CARS_A_FRAME * frames),
            reads[step] * IMAGE_BYTES * frames,
            resumes=step == "detect",
        )
        for step in STEPS
    }


def expected(fit: Fit, frames: float, cars: float) -> float:
    """What a fit says of a step."""
    return fit["fixed"] + fit.get("frames", 0.0) * frames + fit.get("cars", 0.0) * cars


def drives_of(
    count: int,
    fits: Mapping[str, Fit],
    reads: Mapping[str, float],
    ratios: Sequence[float],
    *,
    straggler_sigma: float = 0.0,
    seed: int = 0,
) -> Drives:
    """Drives of drawn lengths."""
    lengths = random.Random(f"{seed}/frames")
    frames = [max(20, round(lengths.lognormvariate(0.0, FRAMES_SIGMA) * MEDIAN_FRAMES)) for _ in range(count)]
    tasks = {f"drive_{k:06d}": tasks_of(n, fits, reads) for k, n in enumerate(frames)}
    return Drives(tasks, ratios, straggler_sigma, seed)


def driver_costs(figures: Mapping[str, Any], drives: int, cpus: float) -> DriverCosts:
    """Of the real driver with Ray. What its calls do not explain of its processor time is the scheduler's."""
    calls_s = sum(figures[name] for name in ("ray_submit_s", "ray_wait_s", "ray_get_s"))
    own = [row["task_s"] for row in sorted(figures["own"], key=lambda row: _far(row, drives, cpus))]
    return DriverCosts(
        own[0] + max(0.0, figures["ray_driver_s"] - calls_s),
        figures["ray_submit_s"],
        figures["ray_wait_s"],
        figures["ray_wait_reference_s"],
        figures["ray_get_s"],
        figures["ray_board_s"],
        figures["ray_board_row_s"],
    )


def _far(row: Mapping[str, Any], drives: int, cpus: float) -> float:
    """How far a measured size is from another, in magnitudes."""
    return abs(log(row["drives"] / drives)) + abs(log(row["cpus"] / cpus))
