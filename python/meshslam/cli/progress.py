"""Progress on stderr: bars on a terminal, now and then a line in a log file or on a terminal that moves no cursor."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from meshslam.cli.quiet import is_quiet
from meshslam.runs import Outlet
from meshslam.viewing import FRAMES_IN_REPORT, RunLog

Step = Callable[[str, int, int], None]
EVERY_S = 10.0  # a line, of a step that goes on


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


class Lines:
    """A line when a step ends, and every `EVERY_S` seconds while it goes on: no colours, no cursor is moved."""

    def __init__(self, write: Callable[[str], None], now_s: Callable[[], float] = time.monotonic) -> None:
        self._write, self._now_s = write, now_s
        self._began_s = self._said_s = now_s()
        self._step = ""

    def __call__(self, step: str, done: int, total: int) -> None:
        """Say that `done` of `total` are done, if it is time to."""
        now_s = self._now_s()
        if step != self._step:
            self._step, self._began_s, self._said_s = step, now_s, now_s
        if done >= total > 0 or now_s - self._said_s >= EVERY_S:
            self._said_s = now_s
            self._write(f"{step}: {done}/{total} after {now_s - self._began_s:.0f} s")


@contextmanager
def progress_bars() -> Iterator[Step]:
    """Progress while the block runs; nothing with `--quiet`."""
    console = Console(stderr=True)
    if is_quiet():
        yield lambda _step, _done, _total: None
    elif not console.is_terminal or console.is_dumb_terminal:
        yield Lines(lambda line: print(line, file=sys.stderr, flush=True))
    else:
        columns = (TextColumn("{task.description:<14}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        progress = Progress(*columns, console=console, refresh_per_second=4)  # 10 took 6% of a core
        try:
            yield Bars(progress)
        finally:
            if progress.live.is_started:
                progress.stop()


@contextmanager
def run_outlet(log: RunLog | None = None, frames_in_report: int | None = None) -> Iterator[Outlet]:
    """Progress and notes of a run on stderr while the block runs; `log` is where the run is shown or kept."""
    frames = FRAMES_IN_REPORT if frames_in_report is None else frames_in_report
    with progress_bars() as bars:
        yield Outlet(bars, lambda note: print(f"note: {note}", file=sys.stderr), log, frames)
