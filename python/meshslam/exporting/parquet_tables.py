"""The tables as Parquet."""

from __future__ import annotations

from pathlib import Path

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.exporting.tables import Columns, object_table, trajectory_table

_WHOLE = {"id", "views", "first_frame", "last_frame", "mesh_vertices", "mesh_faces", "frame"}
_TEXT, _TRUTH = {"category", "source"}, {"extrapolated"}


def write(run: FinishedRun, target: Path) -> Notes:
    """objects.parquet and trajectory.parquet; columns have the same types whatever is known."""
    target.mkdir()
    for name, table in (("objects", object_table(run)), ("trajectory", trajectory_table(run))):
        _write(table, target / f"{name}.parquet")
    return ()


def _write(table: Columns, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    def kind(name: str) -> pa.DataType:
        if name in _WHOLE:
            return pa.int64()
        return pa.string() if name in _TEXT else pa.bool_() if name in _TRUTH else pa.float64()

    columns = {name: pa.array(values, kind(name)) for name, values in table.items()}
    pq.write_table(pa.table(columns), path)
