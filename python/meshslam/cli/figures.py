"""Shows a run's figures."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

import typer

from meshslam.cli.quiet import is_quiet

NOTHING = 3  # exit code: done, but nothing was mapped or used
UNKNOWN = "-"


def show_figures(figures: dict[str, float], out: Path, *, as_json: bool) -> None:
    """Print a run's figures with their units, what was left out, and where its report is."""
    if as_json:
        print((out / "metrics.json").read_text(encoding="utf-8"), end="")
        return
    if is_quiet():
        return
    print_table(figures, out)
    for said in (moving_line(figures, out), left_out_line(out)):
        if said:
            print(said)
    print(f"{out / 'report.html'}: open it in a browser, or: meshslam view {out}")


def show_merge(figures: dict[str, float], out: Path, *, as_json: bool) -> None:
    """Print a merge's figures, and where its page is."""
    if as_json:
        print((out / "metrics.json").read_text(encoding="utf-8"), end="")
    elif not is_quiet():
        print_table(figures, out)
        print(f"{out / 'merge.html'}: open it in a browser")


def print_table(figures: dict[str, float], out: Path) -> None:
    """Figures with their units, in groups."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table("figure", "value", "", title=str(out), box=box.SIMPLE_HEAD, pad_edge=False)
    table.columns[1].justify = "right"
    group = ""
    for new_group, label, value, unit in rows_of(figures):
        if new_group != group:
            table.add_section()
            table.add_row(f"[bold]{new_group}[/bold]")
            group = new_group
        table.add_row(f"  {label}", value, unit)
    Console().print(table)


def rows_of(figures: Mapping[str, object]) -> list[tuple[str, str, str, str]]:
    """Group, name, value and unit of each figure, groups together; what is no number is left out."""
    from meshslam.viewing import describe

    rows = []
    for key, value in figures.items():
        if isinstance(value, int | float):
            shown = describe(key)
            text = f"{value:.{shown.decimals}f}" if math.isfinite(value) else UNKNOWN
            rows.append((shown.group, shown.label, text, shown.unit))
    order = list(dict.fromkeys(row[0] for row in rows))
    return sorted(rows, key=lambda row: order.index(row[0]))


def moving_line(figures: Mapping[str, float], out: Path) -> str:
    """How many objects drive, and where their paths are; empty if none does."""
    count = int(figures.get("objects_moving", 0))
    if not count:
        return ""
    try:
        entries = json.loads((out / "map.json").read_text(encoding="utf-8"))["moving"]
        speeds = sorted(float(entry["speed_m_s"]["mean"]) for entry in entries)
        kinds = {str(entry["category"]) for entry in entries}
    except (OSError, ValueError, KeyError, TypeError):
        return ""
    kind = kinds.pop() if len(kinds) == 1 else "object"
    named = f"1 {kind} that drives" if count == 1 else f"{count} {kind}s that drive"
    span = f"{speeds[0]:.1f} m/s" if count == 1 else f"{speeds[0]:.1f} to {speeds[-1]:.1f} m/s"
    return f"{named}: {span} ({out / 'moving'})"


def left_out_line(out: Path) -> str:
    """How many tracks or views were left out, and why; empty if none was, or if the run does not say."""
    try:
        found = json.loads((out / "left_out.json").read_text(encoding="utf-8"))
        what, reasons = "views" if "views" in found else "tracks", found["reasons"]
        counts = sorted(((int(count), str(name)) for name, count in reasons.items()), key=lambda row: (-row[0], row[1]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return ""
    if not counts:
        return ""
    listed = ", ".join(f"{count} {name.replace('_', ' ')}" for count, name in counts)
    return f"left out: {sum(count for count, _ in counts)} {what}: {listed} ({out / 'left_out.json'})"


def end_without(count: float) -> None:
    """Exit code 3 if a run is done, but nothing was mapped or used."""
    if not count:
        raise typer.Exit(NOTHING)
