"""TUM's trajectory: `time tx ty tz qx qy qz qw` a line, world_from_camera."""

from __future__ import annotations

from pathlib import Path

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes


def write(run: FinishedRun, target: Path) -> Notes:
    """Seconds and metres, nine decimals."""
    target.write_bytes(run.path.to_tum())
    return ()
