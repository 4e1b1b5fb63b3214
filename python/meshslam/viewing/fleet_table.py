"""A page over the drives of a fleet: how each ended and its figures, failures first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from string import Template

from meshslam.viewing.markup import UNKNOWN, asset, number, table, text

HEADINGS = ["drive", "ended", "objects", "frames", "seconds", "peak memory, MB", "attempts", "machine", "recording"]
COUNTED = {"failed": "failed", "not run": "not run", "done": "done", "unchanged": "unchanged"}


@dataclass(frozen=True)
class FleetRow:
    """A drive: `how` it ended is done, unchanged (its run was there), failed, or not run."""

    name: str
    how: str
    reason: str
    command: str
    recording: str
    report: str | None  # relative to the page
    objects: float | None
    frames: float | None
    seconds: float
    peak_memory_mb: float | None
    attempts: int
    node: str
    notes: tuple[str, ...] = ()


def fleet_page(title: str, rows: Sequence[FleetRow], files: Sequence[str] = ()) -> str:
    """One HTML page that opens offline; rows in the order that they are given, `files` are beside it."""
    return Template(asset("fleet.html")).substitute(
        title=text(title),
        style=asset("report.css"),
        counts="".join(_count(rows, how) for how in COUNTED),
        table=table(HEADINGS, [_cells(row) for row in rows], "fleet"),
        files=" ".join(f'<a class=button href="{text(name)}">{text(name)}</a>' for name in files),
    )


def _count(rows: Sequence[FleetRow], how: str) -> str:
    count = sum(row.how == how for row in rows)
    return f"<div><dt>{COUNTED[how]}</dt><dd>{count}</dd></div>" if count else ""


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _cells(row: FleetRow) -> list[str]:
    name = text(row.name) if row.report is None else f'<a href="{text(row.report)}">{text(row.name)}</a>'
    said = f'<p class="doubt why">{text(row.reason)}</p>' if row.reason else ""
    notes = "".join(f"<li>{text(note)}</li>" for note in row.notes)
    folded = (
        f"<details><summary>{_counted(len(row.notes), 'note')}</summary><ul>{notes}</ul></details>" if notes else ""
    )
    return [
        f"<span><b>{name}</b> <small>{text(row.command)}</small></span>",
        f'<span class="how {row.how.replace(" ", "-")}">{text(row.how)}</span>{said}{folded}',
        number(row.objects, 0),
        number(row.frames, 0),
        number(row.seconds, 1),
        number(row.peak_memory_mb, 0),
        str(row.attempts),
        text(row.node) or UNKNOWN,
        f"<small>{text(row.recording)}</small>",
    ]
