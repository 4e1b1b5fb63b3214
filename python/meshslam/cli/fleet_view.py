"""How a fleet is doing: one live view on a terminal, lines in a log file."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from typing import TYPE_CHECKING

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from meshslam.cli.figures import NOTHING
from meshslam.cli.progress import Lines
from meshslam.cli.quiet import is_quiet

if TYPE_CHECKING:
    from meshslam.fleet import DriveResult, Running, Watch

FAILED = 1  # exit code: a drive failed


@contextmanager
def fleet_watch(total: int) -> Iterator[Watch]:
    """Tell of a fleet on stderr while the block runs; with `--quiet`, of failures and lost workers only.

    Nothing is printed on stdout meanwhile: there Ray prints the logs of nodes that are lost, whatever it is told.
    """
    with redirect_stdout(StringIO()), _told(total) as watch:
        yield watch


@contextmanager
def _told(total: int) -> Iterator[Watch]:
    from meshslam.fleet import Watch

    console = Console(stderr=True)
    if is_quiet():
        yield Watch(lambda result: _say(line_of(result)) if result.reason else None, _say)
    elif not console.is_terminal or console.is_dumb_terminal:
        lines = FleetLines(total, _say)
        yield Watch(lines.ended, _say, lines.running)
    else:
        with Live(console=console, refresh_per_second=4, transient=True, redirect_stdout=False) as live:
            view = FleetTable(total, live)
            yield Watch(view.ended, live.console.print, view.running)


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


class FleetLines:
    """A line for each drive that has ended, and one every ten seconds of what is running."""

    def __init__(self, total: int, write: Callable[[str], None]) -> None:
        self._total, self._ended = total, 0
        self._write, self._doing = write, ""
        self._lines = Lines(lambda line: write(f"{line}{self._doing}"))

    def ended(self, result: DriveResult) -> None:
        """Say how a drive ended."""
        self._ended += 1
        self._write(line_of(result))

    def running(self, rows: Sequence[Running]) -> None:
        """Say what is running, if it is time to."""
        self._doing = "".join(f"; {row.drive}: {doing_of(row)}" for row in rows)
        self._lines("drives", self._ended, self._total)


class FleetTable:
    """What is running, a row each, and how many drives have ended; those that have are printed above it."""

    def __init__(self, total: int, live: Live) -> None:
        self._total, self._live, self._ended, self._failed = total, live, 0, 0

    def ended(self, result: DriveResult) -> None:
        """Print how a drive ended."""
        self._ended += 1
        self._failed += result.how == "failed"
        self._live.console.print(Text(line_of(result), style="red" if result.reason else ""))

    def running(self, rows: Sequence[Running]) -> None:
        """Draw what is running."""
        table = Table.grid(padding=(0, 2))
        failed = f", {self._failed} failed" if self._failed else ""
        bar = ProgressBar(self._total, self._ended, width=30)
        table.add_row("drives", bar, f"{self._ended}/{self._total}{failed}")
        for row in sorted(rows, key=lambda row: row.drive):
            bar = ProgressBar(max(1, row.total), min(row.done, max(1, row.total)), width=30)
            table.add_row(row.drive, bar, doing_of(row))
        self._live.update(Group(table))


def line_of(result: DriveResult) -> str:
    """How a drive ended, in a line."""
    if result.reason:
        return f"{result.name}: failed: {result.reason}"
    again = f", {result.attempts} attempts" if result.attempts > 1 else ""
    objects = "" if result.objects is None else f", {result.objects:.0f} objects"
    return f"{result.name}: {result.how}{objects}, {result.seconds:.1f} s on {result.node}{again}"


def doing_of(row: Running) -> str:
    """What a step does, in words."""
    of = f": {row.doing} {row.done}/{row.total}" if row.doing else ""
    return f"{row.step}{of}"


def end_of_fleet(results: Sequence[DriveResult], out: str) -> int:
    """Print where the summary is, what failed and what found nothing; the exit code."""
    from meshslam.fleet import PAGE, can_write_parquet

    failed = [result for result in results if result.how == "failed"]
    empty = [result for result in results if result.found_nothing]
    for result in empty:
        why = next((note for note in result.notes if note.startswith("0 ")), "see its report")
        _say(f"nothing found: {result.name}: {why}")
    if not can_write_parquet():
        _say("note: no summary.parquet: it needs pyarrow: pip install 'meshslam[parquet]'")
    if not is_quiet():
        for result in failed:
            print(f"failed: {result.name}: {result.reason}")
        counts = {how: sum(result.how == how for result in results) for how in ("done", "unchanged", "failed")}
        said = ", ".join(f"{count} {how}" for how, count in counts.items() if count)
        print(f"{len(results)} drives: {said}: {out.rstrip('/')}/{PAGE}")
    return FAILED if failed else NOTHING if empty and len(empty) == len(results) else 0
