"""What drives' steps cost: seconds of a usual machine, and bytes of the shared storage."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Task:
    """One step of a drive on a machine of usual speed that has it alone."""

    compute_s: float
    read_bytes: float = 0.0
    resumes: bool = False  # what a lost worker had done stays in the run directory


@dataclass(frozen=True)
class Drives:
    """Steps by drive, in their order, and how far a task's time differs from them."""

    tasks: Mapping[str, Mapping[str, Task]]
    ratios: Sequence[float] = (1.0,)  # measured time over expected time, one of them is drawn for each task
    straggler_sigma: float = 0.0  # of the logarithm of a factor on every attempt
    seed: int = 0

    def after(self, drive: str, step: str) -> tuple[str, ...]:
        """The steps that are left when one has ended."""
        steps = tuple(self.tasks[drive])
        return steps[steps.index(step) + 1 :]

    def factor(self, drive: str, step: str, attempt: int) -> float:
        """Of an attempt's time: the task's own, the same for every attempt, and the attempt's."""
        own = random.Random(f"{self.seed}/{drive}/{step}").choice(self.ratios)
        chance = random.Random(f"{self.seed}/{drive}/{step}/{attempt}")
        return own * chance.lognormvariate(0.0, self.straggler_sigma) if self.straggler_sigma else own
