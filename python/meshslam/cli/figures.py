"""Shows a run's figures."""

from __future__ import annotations

from pathlib import Path

import typer

NOTHING = 3  # exit code: done, but nothing was mapped or used


def show_figures(figures: dict[str, float], out: Path, *, as_json: bool) -> None:
    """Print a run's figures, and where its report is."""
    if as_json:
        print((out / "metrics.json").read_text(encoding="utf-8"), end="")
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("figure", "value", title=str(out))
    for key, value in figures.items():
        table.add_row(key, f"{value:.3f}" if isinstance(value, float) else str(value))
    Console().print(table)
    print(f"{out / 'report.html'}: open it in a browser")


def end_without(count: float) -> None:
    """Exit code 3 if a run is done, but nothing was mapped or used."""
    if not count:
        raise typer.Exit(NOTHING)
