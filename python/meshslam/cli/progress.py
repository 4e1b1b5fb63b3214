"""Progress bars on stderr."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from meshslam.runs import Outlet
from meshslam.viewing import FRAMES_IN_REPORT, RunLog


class Bars:
    """One bar a step."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._tasks: dict[str, TaskID] = {}

    def __call__(self, step: str, done: int, total: int) -> None:
        """Show that `done` of `total` are done."""
        self._progress.start()
        if step not in self._tasks:
            self._tasks[step] = self._progress.add_task(step, total=total)
        self._progress.update(self._tasks[step], completed=done)


@contextmanager
def progress_bars() -> Iterator[Bars]:
    """Bars while the block runs; without a terminal they stay silent until a step ends."""
    columns = (TextColumn("{task.description:<14}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    progress = Progress(*columns, console=Console(stderr=True), refresh_per_second=4)  # 10 took 6% of a core
    try:
        yield Bars(progress)
    finally:
        if progress.live.is_started:
            progress.stop()


@contextmanager
def run_outlet(log: RunLog | None = None, frames_in_report: int | None = None) -> Iterator[Outlet]:
    """Bars and notes of a run on stderr while the block runs; `log` is where the run is shown or kept."""
    frames = FRAMES_IN_REPORT if frames_in_report is None else frames_in_report
    with progress_bars() as bars:
        yield Outlet(bars, lambda note: print(f"note: {note}", file=sys.stderr), log, frames)
