"""`meshslam view`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from meshslam.errors import MapError

PAGE = "report.html"


def view(
    run: Annotated[Path, typer.Argument(help="Folder of a finished run.")],
    rerun: Annotated[bool, typer.Option("--rerun", help="In the Rerun viewer instead of the browser.")] = False,
    open_: Annotated[bool, typer.Option("--open/--no-open", help="Open it, or say only where it is.")] = True,
) -> None:
    """Open a finished run: its page in the browser, or the run in the Rerun viewer.

    Example: meshslam view run
    """
    if not run.is_dir():
        raise MapError(f"{run}: no such run: give the folder of --out")
    if rerun:
        _in_rerun(run)
        return
    page = run / PAGE
    if not page.is_file():
        raise MapError(f"{run}: has no {PAGE}: the run is not finished; the same command again goes on with it")
    address = page.resolve().as_uri()
    print(address)
    if open_:
        import webbrowser

        if not webbrowser.open(address):
            print("note: no browser could be opened here: open the address by hand", file=sys.stderr)


def _in_rerun(run: Path) -> None:
    from meshslam.exporting import FinishedRun, log_run
    from meshslam.viewing import LogTargets, RerunLog

    LogTargets(view=True).check()
    log_run(FinishedRun.load(run), RerunLog(view=True, recording_id=run.resolve().name))
