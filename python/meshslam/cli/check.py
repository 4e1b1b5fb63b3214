"""`meshslam check`."""

from __future__ import annotations

import json as json_text
from pathlib import Path
from typing import Annotated, Any

import typer

from meshslam.cli.options import Classes, Detections, class_list, takes_recording


@takes_recording
def check(
    sequence: Annotated[Path, typer.Argument(help="Folder or file of the recording.")],
    detections: Detections = None,
    classes: Classes = None,
    json: Annotated[bool, typer.Option("--json", help="Print problems and notes with their figures as JSON.")] = False,
    *,
    recording: Any,  # noqa: ANN401 # settings of `input`
) -> None:
    """List every problem of a recording, one a line; exit code 1 if there is any.

    Files are read as runs read them, and judged: units and axes of the IMU, how it is mounted, the convention of poses,
    the camera, times. What runs can handle by themselves is a note and changes no exit code.

    Example: meshslam check 2011_09_26/2011_09_26_drive_0048_sync
    """
    from meshslam.cli.progress import progress_bars
    from meshslam.runs import InputConfig, check_recording, overlaid

    given = {
        "sequence": sequence,
        **recording,
        "detections": detections,
        "category_names": None if classes is None else tuple(class_list(classes)),
    }
    values = {
        key: str(value) if isinstance(value, Path) else value for key, value in given.items() if value is not None
    }
    with progress_bars() as bars:
        found = check_recording(overlaid(InputConfig(), values, "flags"), bars)
    problems = [finding for finding in found if finding.severity == "error"]
    if json:
        rows = [{"severity": f.severity, "code": f.code, "message": f.message, "figures": f.figures} for f in found]
        print(json_text.dumps({"sequence": str(sequence), "problems": len(problems), "findings": rows}, indent=1))
    else:
        for finding in found:
            print(finding.message if finding.severity == "error" else f"note: {finding.message}")
        if not problems:
            print(f"{sequence}: no problem found")
    if problems:
        raise typer.Exit(1)
