"""The summary: tables and page, failures first."""

import csv
import io
import json
import re
from pathlib import Path

import pytest

from meshslam.fleet.drives import Fleet
from meshslam.fleet.places import Folder
from meshslam.fleet.results import DriveResult, Task, failures_first
from meshslam.fleet.summary import csv_of, row_of, save_summary

GOOD = DriveResult(
    "good",
    "done",
    "map",
    "/drives/good",
    "/out/runs/good",
    figures={"objects_mapped": 4.0, "frames": 6.0, "mask_iou_shape": 0.9},
    tasks=(Task("detect", "one", 1.0, 50.0, "done"), Task("map", "two", 2.5, 80.0, "done")),
)
BAD = DriveResult("bad <1>", "failed", "slam", "/drives/bad", "/out/runs/bad", "it is <damaged>", 3, notes=("a note",))


@pytest.fixture
def out(tmp_path):
    save_summary(failures_first([GOOD, BAD]), Fleet(Path("may.yaml"), ()), Folder(tmp_path))
    return tmp_path


def test_failures_come_first_everywhere(out):
    assert [row["drive"] for row in csv.DictReader(io.StringIO((out / "summary.csv").read_text()))] == [
        "bad <1>",
        "good",
    ]
    assert [drive["name"] for drive in json.loads((out / "fleet.json").read_text())["drives"]] == ["bad <1>", "good"]
    page = (out / "fleet.html").read_text()
    assert page.index("bad &lt;1&gt;") < page.index(">good<")


def test_a_row_has_the_figures_of_all_tasks_and_of_the_run():
    row = row_of(GOOD)
    assert (row["seconds"], row["memory_mb"], row["node"], row["objects"]) == (3.5, 80.0, "two", 4.0)
    assert row["mask_iou_shape"] == 0.9
    header, bad, _ = csv_of([row_of(BAD), row]).decode().splitlines()
    assert header.startswith("drive,state,reason,command,recording,run,attempts,node,seconds,memory_mb,objects,")
    assert bad.startswith("bad <1>,failed,it is <damaged>,slam,/drives/bad,runs/bad <1>,3,")


def test_parquet_has_the_same_rows(out):
    pyarrow = pytest.importorskip("pyarrow.parquet")
    rows = pyarrow.read_table(out / "summary.parquet").to_pylist()
    assert [row["drive"] for row in rows] == ["bad <1>", "good"]
    assert (rows[0]["mask_iou_shape"], rows[1]["mask_iou_shape"]) == (None, 0.9)
    assert rows[0]["reason"] == "it is <damaged>"


def test_the_page_opens_offline_and_links_reports(out):
    page = (out / "fleet.html").read_text()
    assert 'href="runs/good/report.html"' in page
    assert "runs/bad" not in page
    assert "it is &lt;damaged&gt;" in page
    assert not re.search(r"https?://", page)
    assert "default-src 'none'" in page
