"""`meshslam merge`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshslam.cli.options import AsJson, ConfigFile, check_inputs
from meshslam.errors import MapError

if TYPE_CHECKING:
    from meshslam.runs import Config


def merge(
    runs: Annotated[list[Path], typer.Argument(help="Folders of two or more finished runs.")],
    out: Annotated[Path, typer.Option(help="Folder of the merged map.")] = Path("city"),
    poses: Annotated[
        str | None,
        typer.Option(
            help="constellations: worlds are found by the cars that drives share; global: they are one already."
        ),
    ] = None,
    views: Annotated[
        bool | None,
        typer.Option("--views/--no-views", help="Fit shared cars to their views of all drives, or fuse their figures."),
    ] = None,
    allow_outside: Annotated[
        bool, typer.Option("--allow-outside", help="Read meshes of maps that are outside their folders.")
    ] = False,
    config: ConfigFile = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a merged map that is there.")] = False,
    json: AsJson = False,
) -> None:
    """Lay several drives into one world and make the cars that they share one; tell which have moved, come or gone.

    Without --poses global, a drive is found in another by its constellation of parked cars. A drive that shares too
    little with the others keeps a world of its own. Exit code 3: no two drives could be laid on each other.

    Example: meshslam merge monday tuesday wednesday --out city
    """
    from meshslam.files import must_exist

    check_inputs(config, None)
    for run in runs:
        must_exist(run, "run directory", MapError)
    from meshslam.cli.figures import end_without, show_merge
    from meshslam.cli.progress import run_outlet
    from meshslam.runs import Clock, read_config, run_merge

    settings = _with_flags(read_config(config, "merge"), poses, views)
    outside = allow_outside or settings.input.allow_outside
    with run_outlet() as outlet:
        figures = run_merge(
            runs, settings, out, outlet, overwrite=overwrite, allow_outside=outside, clock=Clock.of_process()
        )
    show_merge(figures, out, as_json=json)
    end_without(figures["drives_in_world"] > 1)


def _with_flags(settings: Config, poses: str | None, views: bool | None) -> Config:
    from meshslam.runs import overlaid

    given = {key: value for key, value in (("poses", poses), ("use_views", views)) if value is not None}
    return overlaid(settings, {"merging": given}, "flags") if given else settings
