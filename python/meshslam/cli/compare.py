"""`meshslam compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Mapping

    from meshslam.sequences import Progress
    from meshslam.viewing import Comparison


def compare(
    runs: Annotated[list[Path], typer.Argument(help="Folders of two or more runs; others differ from the first.")],
    out: Annotated[Path, typer.Option(help="HTML page to write.")] = Path("comparison.html"),
    truth: Annotated[
        Path | None,
        typer.Option(help="Measure each run as `meshslam evaluate --truth` does, and compare these figures, too."),
    ] = None,
    align: Annotated[
        bool, typer.Option("--align", help="Lay paths and maps on the first run by the paths (SE(3)).")
    ] = False,
    allow_outside: Annotated[
        bool, typer.Option("--allow-outside", help="Read meshes of maps that are outside their folders.")
    ] = False,
) -> None:
    """Compare finished runs: figures, cars matched by place, paths from above, the same frames drawn by each.

    The page opens offline. In the table, * marks the better figure.

    Example: meshslam compare run_default run_gradient --out comparison.html
    """
    from meshslam.errors import MapError, SequenceError
    from meshslam.files import must_exist

    for run in runs:
        must_exist(run, "run directory", MapError)
    if len(runs) < 2:
        raise MapError(f"{runs[0]}: one run: a comparison needs two or more")
    if truth is not None:
        must_exist(truth, "truth", SequenceError)
    from meshslam.cli.progress import progress_bars
    from meshslam.maps import write_atomically
    from meshslam.runs import compare_runs
    from meshslam.viewing import comparison_page

    with progress_bars() as bars:
        measured: list[Mapping[str, float]] = []
        if truth is not None:
            measured = [_measured(run, truth, bars, align=align, outside=allow_outside) for run in runs]
        found = compare_runs(runs, more_figures=measured, align=align, allow_outside=allow_outside, progress=bars)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(out, comparison_page(found).encode())
    _show(found)
    print(f"{out}: open it in a browser")


def _measured(run: Path, truth: Path, bars: Progress, *, align: bool, outside: bool) -> Mapping[str, float]:
    """All figures that `evaluate` finds."""
    from meshslam.evaluation import measure
    from meshslam.runs import Measurable, read_material

    material, _ = read_material(Measurable(run, truth=truth, allow_outside=outside))
    rows = measure(material.aligned() if align else material, (), bars)
    return {key: value for row in rows for key, value in row.figures.items()}


def _show(found: Comparison) -> None:
    """Print figures and cars."""
    import sys

    from rich.console import Console
    from rich.table import Table

    from meshslam.viewing import LETTERS, figure_rows_of, figure_text

    for note in found.notes:
        print(f"note: {note}", file=sys.stderr)
    table = Table("figure", *(f"{LETTERS[i]} {run.name}" for i, run in enumerate(found.runs)), title="* better")
    for row in figure_rows_of(found.runs):
        cells = [
            "" if value is None else f"{'* ' if i in row.best else ''}{figure_text(row.key, value)}"
            for i, value in enumerate(row.values)
        ]
        table.add_row(row.key, *cells)
    Console().print(table)
    for i, cars in enumerate(found.cars, 1):
        table = Table("A", LETTERS[i], "apart, cm", "yaw, deg", "length / width / height, cm", "mesh IoU")
        table.title = f"cars: A to {LETTERS[i]}"
        for pair in cars.pairs:
            apart_cm = 100 * float((pair.centre_m**2).sum() ** 0.5)
            size = " / ".join(f"{100 * v:+.1f}" for v in pair.size_m)
            cells = [f"{apart_cm:.1f}", f"{pair.yaw_deg:+.1f}", size, f"{pair.iou:.3f}"]
            table.add_row(str(pair.first_id), str(pair.other_id), *cells)
        if cars.pairs:
            Console().print(table)
        for letter, numbers in (("A", cars.only_first), (LETTERS[i], cars.only_other)):
            if numbers:
                print(f"only in {letter}: {', '.join(map(str, numbers))}")
