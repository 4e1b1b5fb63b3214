"""`meshslam fleet` as it is typed: what it lists, what it refuses, what it says on a terminal."""

import io
import os
import pty
import subprocess

import pytest
import yaml
from rich.console import Console
from rich.live import Live

from meshslam.cli.fleet_view import FleetLines, FleetTable, end_of_fleet, line_of
from meshslam.fleet import DriveResult, Running
from meshslam.fleet.summary import parquet_of
from tests.cli.conftest import COMMAND, ENVIRONMENT, done, error_of, meshslam

FAILED = DriveResult("bad", "failed", "map", "/drives/bad", "/out/runs/bad", "it is damaged")
DONE = DriveResult("good", "done", "map", "/drives/good", "/out/runs/good", attempts=2, figures={"objects_mapped": 4.0})


@pytest.fixture
def file(source, tmp_path):
    path = tmp_path / "drives.yaml"
    path.write_text(yaml.safe_dump([{"name": "one", "recording": str(source)}, {"name": "gone", "recording": "gone"}]))
    return path


def test_a_plan_opens_nothing_and_lists_every_drive(file, source):
    for given in (("plan", file), ("run", file, "--out", file.parent / "out", "--dry-run")):
        shown = done("fleet", *given).stdout
        assert f"one   map       {source}" in shown
        assert f"gone  map       {file.parent / 'gone'}" in shown
        assert "2 drives" in shown
    assert not (file.parent / "out").exists()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--address", "auto"), "--address is that of a Ray cluster: give --engine ray, too"),
        (("--out", "nosuch://maps"), "nosuch://"),
    ],
)
def test_flags_that_cannot_be_meant_are_refused(file, more, said):
    given = more if "--out" in more else ("--out", file.parent / "out", *more)
    assert said in error_of(meshslam("fleet", "run", file, *given))


def test_a_missing_file_is_one_line(tmp_path):
    assert "no such fleet file" in error_of(meshslam("fleet", "run", tmp_path / "none.yaml", "--out", tmp_path / "out"))


def test_quiet_tells_failures_alone(file):
    result = meshslam("fleet", "run", file, "--out", file.parent / "out", "--quiet")
    assert result.returncode == 1
    assert result.stdout == ""
    assert result.stderr == f"gone: failed: {file.parent / 'gone'}: no such folder or file\n"


def test_drives_that_find_nothing_are_said_with_the_reason(source, tmp_path):
    nothing = {"name": "none", "recording": str(source), "settings": {"mapping": {"max_distance_m": 0.5}}}
    path = tmp_path / "drives.yaml"
    path.write_text(yaml.safe_dump([nothing]))
    for more in ((), ("--quiet",)):
        result = meshslam("fleet", "run", path, "--out", tmp_path / "out", *more)
        assert result.returncode == 3, result.stderr
        assert "nothing found: none: 0 objects mapped: of " in result.stderr
    path.write_text(yaml.safe_dump([nothing, {"name": "some", "recording": str(source)}]))
    result = meshslam("fleet", "run", path, "--out", tmp_path / "out")
    assert result.returncode == 0
    assert "nothing found: none: " in result.stderr
    assert "nothing found: some" not in result.stderr


def test_a_localization_without_views_has_found_nothing():
    used = [
        DriveResult("a", "done", "localize", "a", "a", figures={"views_used": n, "objects_mapped": 0}) for n in (0, 3)
    ]
    assert [result.found_nothing for result in used] == [True, False]
    assert not FAILED.found_nothing


def test_without_pyarrow_it_is_said_that_there_is_no_parquet(monkeypatch, capsys):
    monkeypatch.setattr("meshslam.fleet.summary.can_write_parquet", lambda: False)
    monkeypatch.setattr("meshslam.fleet.can_write_parquet", lambda: False, raising=False)
    assert parquet_of([]) is None
    assert end_of_fleet([DONE], "/out") == 0
    assert "pip install 'meshslam[parquet]'" in capsys.readouterr().err


def test_lines_of_a_log():
    assert line_of(FAILED) == "bad: failed: it is damaged"
    assert line_of(DONE).startswith("good: done, 4 objects, 0.0 s on ")
    assert line_of(DONE).endswith(", 2 attempts")
    said = []
    lines = FleetLines(2, said.append)
    lines.running([Running("good", "map", "fit", 3, 9)])
    lines.ended(DONE)
    lines.ended(FAILED)
    lines.running([])
    assert said == [line_of(DONE), line_of(FAILED), "drives: 2/2 after 0 s"]


def test_one_live_view_shows_what_runs_and_what_failed():
    text = io.StringIO()
    console = Console(file=text, width=100, force_terminal=True)
    with Live(console=console, auto_refresh=False) as live:
        view = FleetTable(3, live)
        view.ended(FAILED)
        view.running([Running("good", "map", "fit", 3, 9), Running("next", "detect")])
        live.refresh()
    shown = text.getvalue()
    assert "bad: failed: it is damaged" in shown
    assert "1/3, 1 failed" in shown
    assert "map: fit 3/9" in shown
    assert "detect" in shown


def test_on_a_terminal_the_view_is_drawn_and_goes(file):
    leader, follower = pty.openpty()
    command = [*COMMAND, "fleet", "run", str(file), "--out", str(file.parent / "out")]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=follower, env={**ENVIRONMENT, "TERM": "xterm"}, text=True
    )
    os.close(follower)
    shown = bytearray()
    while True:
        try:
            part = os.read(leader, 65536)
        except OSError:  # the process has closed it
            break
        shown += part
    os.close(leader)
    said, _ = process.communicate(timeout=60)
    assert process.returncode == 1
    assert b"\x1b[" in shown
    assert b"Traceback" not in shown
    assert "1 done, 1 failed" in said
