"""The summary of a fleet: fleet.json, a table as CSV and Parquet, and a page; failures first in all of them."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

from meshslam.fleet.drives import Fleet
from meshslam.fleet.places import RUNS, Place
from meshslam.fleet.results import DriveResult
from meshslam.viewing import FleetRow, fleet_page

PAGE = "fleet.html"  # of the summary
JSON, CSV, PARQUET = "fleet.json", "summary.csv", "summary.parquet"
OWN = ("drive", "state", "reason", "command", "recording", "run", "attempts", "node", "seconds", "memory_mb", "objects")


def save_summary(results: Sequence[DriveResult], fleet: Fleet, place: Place) -> None:
    """Write all of it; the Parquet file where pyarrow is installed."""
    rows = [row_of(result) for result in results]
    place.save(JSON, _json(results, fleet))
    place.save(CSV, csv_of(rows))
    parquet = parquet_of(rows)
    if parquet is not None:
        place.save(PARQUET, parquet)
    files = (CSV, *([] if parquet is None else [PARQUET]), JSON)
    shown = [_shown(result) for result in results]
    place.save(PAGE, fleet_page(fleet.source.stem, shown, files).encode())


def row_of(result: DriveResult) -> dict[str, Any]:
    """A drive as a row: what it was and how it ended, then the run's own figures under their names."""
    own = (
        result.name,
        result.how,
        result.reason,
        result.command,
        result.recording,
        f"{RUNS}/{result.name}",
        result.attempts,
        result.node,
        result.seconds,
        result.peak_memory_mb,
        result.objects,
    )
    return {**dict(zip(OWN, own, strict=True)), **{k: v for k, v in result.figures.items() if k not in OWN}}


def columns(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Those of every row, then each figure that any drive has."""
    return [*OWN, *sorted({name for row in rows for name in row} - set(OWN))]


def csv_of(rows: Sequence[dict[str, Any]]) -> bytes:
    """The table as CSV; what a drive does not have is empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns(rows), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def can_write_parquet() -> bool:
    """Whether pyarrow is installed."""
    return find_spec("pyarrow") is not None


def parquet_of(rows: Sequence[dict[str, Any]]) -> bytes | None:
    """The table as Parquet; None without pyarrow."""
    if not can_write_parquet():
        return None
    import pyarrow
    import pyarrow.parquet

    texts = set(OWN[:6]) | {"node"}
    named = {
        name: pyarrow.array(
            [row.get(name) if name in texts or row.get(name) is None else float(row[name]) for row in rows],
            pyarrow.string() if name in texts else pyarrow.float64(),
        )
        for name in columns(rows)
    }
    sink = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(pyarrow.table(named), sink)
    content: bytes = sink.getvalue().to_pybytes()
    return content


def _json(results: Sequence[DriveResult], fleet: Fleet) -> bytes:
    counts = {how: sum(result.how == how for result in results) for how in ("done", "unchanged", "failed", "not run")}
    drives = [asdict(result) for result in results]
    document = {"format": "meshslam-fleet", "meshslam": version("meshslam"), "fleet": str(fleet.source), **counts}
    return (json.dumps({**document, "drives": drives}, indent=1, allow_nan=False) + "\n").encode()


def _shown(result: DriveResult) -> FleetRow:
    report = f"{RUNS}/{result.name}/report.html" if result.how in ("done", "unchanged") else None
    frames = result.figures.get("frames")
    return FleetRow(
        result.name,
        result.how,
        result.reason,
        result.command,
        result.recording,
        report,
        result.objects,
        frames,
        result.seconds,
        result.peak_memory_mb or None,
        result.attempts,
        result.node,
        tuple(result.notes),
    )
