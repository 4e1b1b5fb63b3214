"""`meshslam demo`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from meshslam.cli.options import AsJson, Overwrite


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the recording and the run.")] = Path("demo"),
    seed: Annotated[int, typer.Option(help="Seed of the street: the same seed gives the same bytes.")] = 0,
    overwrite: Overwrite = False,
    json: AsJson = False,
) -> None:
    """Make a street of cars, drive through it, map it, and compare the map with the truth.

    Example: meshslam demo --out demo
    """
    from meshslam.categories import load_category
    from meshslam.cli.config import Config, InputConfig
    from meshslam.cli.figures import show_figures
    from meshslam.cli.map import run_map
    from meshslam.cli.progress import progress_bars
    from meshslam.simulation import make_street, write_recording

    if seed < 0:
        raise typer.BadParameter(f"a seed is 0 or more, found {seed}", param_hint="--seed")
    refuse_foreign(out)
    recording = out.resolve() / f"street_{seed}"
    with progress_bars() as bars:
        write_recording(make_street(load_category("car"), seed), recording, progress=bars)
    figures = run_map(Config(InputConfig(sequence=str(recording))), out / "run", overwrite=overwrite)
    show_figures(figures, out / "run", as_json=json)


def refuse_foreign(out: Path) -> None:
    """MapError if a folder holds anything but former demos."""
    from meshslam.errors import MapError

    if out.exists() and not out.is_dir():
        raise MapError(f"{out}: is a file, expected a folder to write the demo into: choose another --out")
    others = (
        sorted(p.name for p in out.iterdir() if not p.name.startswith("street_") and p.name != "run")
        if out.exists()
        else []
    )
    if others:
        raise MapError(f"{out}: holds {', '.join(others[:3])}, which is no demo's: choose another --out")
