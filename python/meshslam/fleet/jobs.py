"""One step of one drive as it travels to a worker, and what comes back: an outcome, never an exception."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from meshslam.fleet.drives import Drive, Needs

LossKind = Literal["worker", "memory"]


@dataclass(frozen=True)
class Job:
    """A step to do. The run directory is `out` where all machines share it; else `files` are its content so far."""

    drive: Drive
    step: str
    needs: Needs
    version: str  # of meshslam, the same everywhere
    out: str | None = None
    files: Mapping[str, bytes] = field(default_factory=dict)
    overwrite: bool = False


@dataclass(frozen=True)
class Outcome:
    """What a step gave, good or bad."""

    left: tuple[str, ...] = ()  # steps
    figures: Mapping[str, float] | None = None  # of a run that is complete
    notes: tuple[str, ...] = ()
    was_there: bool = False  # the run was complete before
    reason: str = ""  # why the drive failed
    fault: str = ""  # the traceback, where the reason is a fault of meshslam
    seconds: float = 0.0
    peak_memory_mb: float = 0.0
    node: str = ""
    changes: Mapping[str, bytes | None] = field(default_factory=dict)  # files of a run that is carried; None: gone


@dataclass(frozen=True)
class Loss:
    """Why a step gave no outcome: its worker, or the machine, was lost."""

    kind: LossKind
    text: str


@dataclass(frozen=True)
class Ended:
    """A job that is no longer under way."""

    job: Job
    result: Outcome | Loss


@dataclass(frozen=True)
class Running:
    """How far a job is."""

    drive: str
    step: str
    doing: str = ""  # what the step does, such as `segment`
    done: int = 0
    total: int = 0
