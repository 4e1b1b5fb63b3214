"""A recording for the Rerun viewer."""

from __future__ import annotations

from pathlib import Path

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.exporting.logs import log_run
from meshslam.viewing import RerunLog


def write(run: FinishedRun, target: Path) -> Notes:
    """The entities of docs/viewers.md."""
    return log_run(run, RerunLog(target, recording_id=run.name))
