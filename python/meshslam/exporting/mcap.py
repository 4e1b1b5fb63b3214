"""A log with Foxglove's schemas."""

from __future__ import annotations

from pathlib import Path

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.exporting.logs import log_run
from meshslam.viewing import McapLog


def write(run: FinishedRun, target: Path) -> Notes:
    """The topics of docs/viewers.md."""
    return log_run(run, McapLog(target))
