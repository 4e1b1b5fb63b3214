"""The tables as CSV; trajectory.csv is the run's own where it has one, with the whole covariances."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.exporting.tables import Columns, object_table, trajectory_table


def write(run: FinishedRun, target: Path) -> Notes:
    """A header, then a line a row; what is not known is empty."""
    target.mkdir()
    (target / "objects.csv").write_text(_text(object_table(run)), encoding="utf-8")
    own = run.estimate
    if own is not None:
        (target / "trajectory.csv").write_bytes(own.to_csv())
    else:
        (target / "trajectory.csv").write_text(_text(trajectory_table(run)), encoding="utf-8")
    return ()


def _text(table: Columns) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    return stream.getvalue()
