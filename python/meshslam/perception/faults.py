"""What is wrong with a detection file: the first is raised, or all are collected."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from meshslam.errors import DetectionError
from meshslam.sequences import Report

Result = TypeVar("Result")


class PlacedError(DetectionError):
    """A problem with its file and its place, raised."""


@dataclass
class Faults:
    """Handed to every reader of detections; without a `report`, `add` raises DetectionError at once."""

    path: Path
    report: Report | None = None  # collects
    notes: list[str] = field(default_factory=list)  # what was handled, one line a kind
    problem_count: int = 0
    progress: Callable[[int, int], None] | None = None  # annotations that are read, of how many

    def add(self, where: str, what: str) -> None:
        """Report what is wrong at a place of the file."""
        if self.report is None:
            raise PlacedError(": ".join(part for part in (str(self.path), where, what) if part))
        self.problem_count += 1
        self.report.add(self.path, where, what)

    def note(self, what: str) -> None:
        """Tell what was handled."""
        self.notes.append(f"{self.path}: {what}")
        if self.report is not None:
            self.report.note(self.path, "", what)

    def attempt(self, where: str, read: Callable[[], Result]) -> Result | None:
        """Run one reader; None where it finds something wrong and this collects."""
        try:
            return read()
        except PlacedError:
            raise
        except DetectionError as error:
            self.add(where, str(error).removeprefix(f"{self.path}: "))
        return None
