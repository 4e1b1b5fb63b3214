"""`meshslam fleet`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from meshslam.cli.quiet import can_be_quiet
from meshslam.errors import ConfigError

Engine = Literal["local", "ray"]

fleet_app = typer.Typer(
    no_args_is_help=True, help="Many drives, on this machine or on a Ray cluster.", pretty_exceptions_enable=False
)
FleetFile = Annotated[Path, typer.Argument(help="Fleet file (YAML) with the drives: docs/fleet.md.", metavar="DRIVES")]


def run(
    drives: FleetFile,
    out: Annotated[str, typer.Option(help="Folder for runs and summary, found again, it is resumed; or a URL.")],
    engine: Annotated[Engine, typer.Option(help="local: processes of this machine; ray: a Ray cluster.")] = "local",
    address: Annotated[
        str | None, typer.Option(help="A Ray cluster's, or auto; without it Ray is started on this machine.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Steps at a time (default: what the CPUs of machine or cluster hold).")
    ] = None,
    retries: Annotated[int, typer.Option(min=0, help="Lost workers of a drive that are replaced.")] = 2,
    shared: Annotated[
        bool, typer.Option("--shared-folder/--no-shared-folder", help="Whether every node has --out at this path.")
    ] = True,
    overwrite: Annotated[bool, typer.Option(help="Replace runs of other settings or input.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List the drives as `fleet plan` does.")] = False,
) -> None:
    """Run every drive of a fleet; each folder of FLEET/runs is what the single command writes, to the same bytes.

    A lost worker is replaced; a drive that is wrong fails alone. The same command again goes on. FLEET/fleet.html lists
    the drives, failures first. Exit code 1: a drive failed; 3: no drive found anything.

    Example: meshslam fleet run drives.yaml --out maps --engine ray --address auto
    """
    _must_exist(drives)
    from meshslam.cli.fleet_view import end_of_fleet, fleet_watch
    from meshslam.fleet import engine_of, place_of, read_fleet, run_fleet

    fleet = read_fleet(drives)
    if dry_run:
        plan(drives)
        return
    place = place_of(out, shared=shared)
    with fleet_watch(len(fleet.drives)) as watch:
        results = run_fleet(
            fleet,
            place,
            lambda: engine_of(engine, address, workers),
            retries=retries,
            overwrite=overwrite,
            watch=watch,
        )
    if code := end_of_fleet(results, out):
        raise typer.Exit(code)


def plan(drives: FleetFile) -> None:
    """List what would be run: every drive with its command and recording. Nothing is opened.

    Example: meshslam fleet plan drives.yaml
    """
    _must_exist(drives)
    from meshslam.fleet import read_fleet

    fleet = read_fleet(drives)
    width = max(len(drive.name) for drive in fleet.drives)
    for drive in fleet.drives:
        print(f"{drive.name:<{width}}  {drive.command:<8}  {drive.recording}")
    print(
        f"{len(fleet.drives)} drives; each goes through: detect ({fleet.needs_of('detect')}), then what is left of it"
    )


def _must_exist(drives: Path) -> None:
    from meshslam.files import must_exist

    must_exist(drives, "fleet file", ConfigError)


fleet_app.command("run")(can_be_quiet(run))
fleet_app.command("plan")(plan)
