"""`meshslam export`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from meshslam.errors import ConfigError, MapError


def export(
    run: Annotated[Path | None, typer.Argument(help="Folder of a finished run.")] = None,
    format_: Annotated[
        list[str] | None,
        typer.Option("--format", "-f", help="Format, several as glb,tum or given again; --list names them."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Where to write: of one format its file or folder, of several a folder; else RUN/export."),
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option(
            help="geojson, 3dtiles: where the map is, LAT,LON[,HEIGHT[,HEADING of its x axis, clockwise from north]]."
        ),
    ] = None,
    images: Annotated[
        bool, typer.Option("--images/--no-images", help="rrd, mcap: with the recording's images.")
    ] = True,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what is there.")] = False,
    list_: Annotated[bool, typer.Option("--list", help="List the formats.")] = False,
) -> None:
    """Write a finished run in the format of another tool: meshes, paths, labels, tables, logs, bags.

    Example: meshslam export run --format glb,tum,geojson --origin 49.011,8.416 --out handed_on
    """
    if list_:
        _list()
        return
    if run is None or not format_:
        missing = "no run is named: give its folder" if run is None else "no format is named: give --format"
        raise ConfigError(f"export: {missing}, such as: meshslam export run --format glb (--list names the formats)")
    if not run.is_dir():
        raise MapError(f"{run}: no such run: give the folder of --out")
    from meshslam.cli.progress import progress_bars
    from meshslam.exporting import GeoOrigin
    from meshslam.runs import export_run

    names = list(dict.fromkeys(name.strip() for part in format_ for name in part.split(",") if name.strip()))
    where = None if origin is None else GeoOrigin.parse(origin)
    with progress_bars() as bars:
        written, notes = export_run(run, names, out, origin=where, images=images, overwrite=overwrite, progress=bars)
    for note in notes:
        print(f"note: {note}", file=sys.stderr)
    for name, path in written.items():
        print(f"{path}: {name}")


def _list() -> None:
    from meshslam.exporting import FORMATS

    width = max(map(len, FORMATS))
    for name, found in FORMATS.items():
        needs = f" (pip install 'meshslam[{found.extra}]')" if found.extra else ""
        print(f"{name:<{width}}  {found.summary}{needs}")
