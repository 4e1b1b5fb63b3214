"""How each drive of a fleet ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from meshslam.fleet.drives import Drive
from meshslam.fleet.jobs import Ended, Loss, Outcome
from meshslam.fleet.places import Place

ORDER = ("failed", "not run", "done", "unchanged")


@dataclass(frozen=True)
class Task:
    """A job that a worker had."""

    step: str
    node: str
    seconds: float
    peak_memory_mb: float
    how: str  # done, failed, or how it was lost

    @staticmethod
    def of(ended: Ended) -> Task:
        """As it ended."""
        step, found = ended.job.step, ended.result
        if isinstance(found, Loss):
            return Task(step, "", 0.0, 0.0, f"lost: {found.text}")
        how = "failed" if found.reason else "done"
        return Task(step, found.node, round(found.seconds, 3), found.peak_memory_mb, how)


@dataclass(frozen=True)
class DriveResult:
    """A drive's end: `how` is done, unchanged (its run was there), failed, or not run."""

    name: str
    how: str
    command: str
    recording: str
    run: str
    reason: str = ""
    attempts: int = 1
    figures: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    fault: str = ""
    tasks: tuple[Task, ...] = ()

    @staticmethod
    def of(
        drive: Drive,
        how: str,
        tasks: Sequence[Task],
        outcome: Outcome | None = None,
        attempts: int = 1,
        place: Place | None = None,
    ) -> DriveResult:
        """The end of a drive, by its last outcome if it has one."""
        found = outcome or Outcome()
        return DriveResult(
            drive.name,
            how,
            drive.command,
            drive.recording,
            "" if place is None else place.run(drive.name),
            found.reason,
            attempts,
            found.figures or {},
            found.notes,
            found.fault,
            tuple(tasks),
        )

    @property
    def objects(self) -> float | None:
        """How many objects are in its map."""
        return self.figures.get("objects_mapped", self.figures.get("objects_in_map"))

    @property
    def found_nothing(self) -> bool:
        """Whether the run is there, but nothing was mapped, or no view of the map was used."""
        used = (
            self.figures.get("views_used", 1) if self.command == "localize" else self.figures.get("objects_mapped", 1)
        )
        return self.how in ("done", "unchanged") and not used

    @property
    def seconds(self) -> float:
        """Of all its tasks."""
        return round(sum(task.seconds for task in self.tasks), 3)

    @property
    def peak_memory_mb(self) -> float:
        """Of the task that took most."""
        return max((task.peak_memory_mb for task in self.tasks), default=0.0)

    @property
    def node(self) -> str:
        """Where its last task ran."""
        return next((task.node for task in reversed(self.tasks) if task.node), "")


def failures_first(results: Sequence[DriveResult]) -> list[DriveResult]:
    """Failed drives, then those that were not run, then the rest in their order."""
    return sorted(results, key=lambda result: min(ORDER.index(result.how), 2))
