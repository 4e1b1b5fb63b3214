"""`meshslam check`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def check(
    sequence: Annotated[Path, typer.Argument(help="Folder of the recording.")],
    layout: Annotated[str | None, typer.Option(help="Name of the layout, where the path does not tell.")] = None,
    camera: Annotated[int | None, typer.Option(help="Which of the layout's cameras.")] = None,
    detections: Annotated[Path | None, typer.Option(help="Detection file, in place of the folder's own.")] = None,
) -> None:
    """List every problem of a recording, one a line; exit code 1 if there is any.

    What runs handle themselves is listed as a note, which leaves the exit code as it is.

    Example: meshslam check 2011_09_26/2011_09_26_drive_0048_sync
    """
    from meshslam.runs import check_recording

    found = check_recording(sequence, layout, camera, detections)
    for entry in found:
        print(f"note: {entry}" if entry.severity == "note" else entry)
    if any(entry.severity == "problem" for entry in found):
        raise typer.Exit(1)
    print(f"{sequence}: no problem found")
