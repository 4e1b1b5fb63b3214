"""How readers say what is wrong: the first problem is raised, or every problem is collected."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Literal, TypeVar

from meshslam.errors import SequenceError

Result = TypeVar("Result")
_QUICK_S = 1.0
LONGEST = 280  # characters of what is said of a file
Progress = Callable[[str, int, int], None]  # step, how many are done, of how many
Severity = Literal["problem", "note"]


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong with an input, or a note: of something that reading could handle."""

    file: Path
    where: str  # the line or key, empty for the file as a whole
    what: str  # what was found, and what was expected
    severity: Severity = "problem"

    def __str__(self) -> str:
        words = f"{self.where}: {self.what}" if self.where else self.what
        return f"{self.file}: {words if len(words) <= LONGEST else words[: LONGEST - 2] + ' …'}"


class FoundError(SequenceError):
    """One problem, raised."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(str(problem))
        self.problem = problem


class IncompleteError(SequenceError):
    """Nothing can be made of a part whose problems are reported already."""


def no_progress(_step: str, _done: int, _total: int) -> None:
    """For callers that need not know."""


def late(progress: Progress) -> Progress:
    """Nothing until a second has passed: what is quick needs no bar."""
    begun = monotonic()
    return lambda step, done, total: progress(step, done, total) if monotonic() - begun > _QUICK_S else None


class Report:
    """Handed to every reader: `add` raises at once, or collects where the caller wants all problems.

    `progress` is told what takes long.
    """

    def __init__(self, *, collect: bool = False, progress: Progress = no_progress) -> None:
        self.progress = progress
        self._collect = collect
        self._problems: dict[Problem, None] = {}

    @property
    def problems(self) -> list[Problem]:
        """What was found so far, notes too, in order, each once."""
        return list(self._problems)

    @property
    def notes(self) -> tuple[str, ...]:
        """The notes alone, as text."""
        return tuple(str(problem) for problem in self._problems if problem.severity == "note")

    def add(self, file: Path, where: str, what: str) -> None:
        """Report a problem that reading can go on behind; raises FoundError unless this report collects."""
        problem = Problem(file, where, what)
        if not self._collect:
            raise FoundError(problem)
        self._problems[problem] = None

    def note(self, file: Path, where: str, what: str) -> None:
        """Report what is worth knowing but stops nothing."""
        self._problems[Problem(file, where, what, "note")] = None

    def attempt(self, read: Callable[[], Result]) -> Result | None:
        """Run one reader; None if it failed and this report collects."""
        try:
            return read()
        except FoundError as error:
            self.add(error.problem.file, error.problem.where, error.problem.what)
        except IncompleteError:
            if not self._collect:
                raise
        return None


def fail(file: Path, where: str, what: str) -> FoundError:
    """Build the error for a problem that ends the reading of its file."""
    return FoundError(Problem(file, where, what))
