"""Where a run tells how far it is, and what its user should know."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from meshslam.viewing import FRAMES_IN_REPORT, RunLog


def _nothing(_step: str, _done: int, _total: int) -> None:
    return


@dataclass(frozen=True)
class Outlet:
    """Progress, notes and the log: the run calls, the command line prints, a program does as it likes."""

    progress: Callable[[str, int, int], None] = _nothing  # what is done, how many are done, of how many
    on_note: Callable[[str], None] | None = None  # called as soon as a note is known
    log: RunLog | None = None  # where frames and objects are shown or kept while the run computes
    frames_in_report: int = FRAMES_IN_REPORT  # with images: spread over the run
    notes: list[str] = field(default_factory=list)  # all of them

    def note(self, text: str) -> None:
        """Tell the user something."""
        self.notes.append(text)
        if self.on_note is not None:
            self.on_note(text)
