"""What commands say on a terminal, in a log file, and with --quiet."""

import json
import os
import subprocess

import pytest

from meshslam.cli.figures import left_out_line, moving_line, rows_of
from meshslam.cli.progress import EVERY_S, Lines
from tests.cli.conftest import COMMAND, ENVIRONMENT, done


def test_figures_have_plain_names_and_units(source, source_run):
    shown = done("map", source, "--out", source_run).stdout
    figures = json.loads((source_run / "metrics.json").read_text())
    assert not any(key in shown for key in figures if "_" in key)
    assert "objects mapped" in shown
    assert "MB" in shown
    assert "report.html" in shown


def test_groups_stay_together_and_what_is_not_known_is_a_dash():
    figures = {"frames": 3, "seconds_total": 1.25, "tracks": 4, "ate_rmse_m": float("nan"), "notes": ["said"]}
    assert rows_of(figures) == [
        ("Run", "frames", "3", ""),
        ("Run", "tracks", "4", ""),
        ("Time and memory", "total", "1.2", "s"),
        ("Against truth", "path error, RMSE", "-", "m"),
    ]


def test_one_line_says_what_was_left_out_and_why(tmp_path):
    assert left_out_line(tmp_path) == ""
    (tmp_path / "left_out.json").write_text('{"reasons": {"moves": 1, "too_small": 9, "other_category": 1}}')
    said = left_out_line(tmp_path)
    assert said.startswith("left out: 11 tracks: 9 too small, 1 moves, 1 other category (")
    (tmp_path / "left_out.json").write_text('{"reasons": {}}')
    assert left_out_line(tmp_path) == ""
    (tmp_path / "left_out.json").write_text('{"reasons": 3')
    assert left_out_line(tmp_path) == ""


def test_one_line_says_how_many_cars_drive(tmp_path):
    assert moving_line({"objects_moving": 0}, tmp_path) == ""
    entries = [{"category": "car", "speed_m_s": {"mean": speed, "max": 9.0}} for speed in (7.04, 3.0)]
    (tmp_path / "map.json").write_text(json.dumps({"moving": entries}))
    assert moving_line({"objects_moving": 2}, tmp_path) == f"2 cars that drive: 3.0 to 7.0 m/s ({tmp_path / 'moving'})"
    (tmp_path / "map.json").write_text(json.dumps({"moving": entries[:1]}))
    assert moving_line({"objects_moving": 1}, tmp_path) == f"1 car that drives: 7.0 m/s ({tmp_path / 'moving'})"
    (tmp_path / "map.json").write_text("[]")
    assert moving_line({"objects_moving": 1}, tmp_path) == ""


def test_quiet_says_nothing_but_notes_and_errors(source, source_run, tmp_path):
    result = done("map", source, "--out", tmp_path / "run", "--quiet")
    assert result.stdout == ""
    assert all(line.startswith("note: ") for line in result.stderr.splitlines())
    assert (tmp_path / "run" / "map.json").read_bytes() == (source_run / "map.json").read_bytes()


def test_progress_in_a_log_file_is_lines_without_escapes(source, tmp_path):
    """Each step that ends is a line; nothing is redrawn."""
    log = tmp_path / "log.txt"
    with log.open("wb") as file:
        command = [*COMMAND, "map", str(source), "--out", str(tmp_path / "run")]
        subprocess.run(command, stdout=file, stderr=file, env={**ENVIRONMENT, "TERM": "xterm-256color"}, check=True)
    text = log.read_bytes()
    assert b"\x1b" not in text
    assert b"\r" not in text
    told = [line.partition(":")[0] for line in text.decode().splitlines()]
    steps = ("read", "initialize", "fit", "shape", "save", "report")  # of a long drive none goes on in silence
    assert [step for step in dict.fromkeys(told) if step in steps] == list(steps)


def test_a_dumb_terminal_gets_no_escapes(source, tmp_path):
    leader, follower = os.openpty()
    command = [*COMMAND, "map", str(source), "--out", str(tmp_path / "run")]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=follower, env={**ENVIRONMENT, "TERM": "dumb"}, start_new_session=True
    )
    os.close(follower)
    shown = bytearray()
    while True:
        try:
            part = os.read(leader, 65536)
        except OSError:  # the process has closed it
            break
        if not part:
            break
        shown += part
    os.close(leader)
    assert process.wait() == 0
    assert b"\x1b" not in shown
    assert b"/" in shown


def test_a_step_that_goes_on_says_so_now_and_then():
    said, now = [], [100.0]
    lines = Lines(said.append, lambda: now[0])
    for done_frames in range(1, 101):
        now[0] += 0.3
        lines("slam", done_frames, 100)
    assert said[-1] == "slam: 100/100 after 30 s"
    assert len(said) == 1 + int((100 - 1) * 0.3 / EVERY_S)
    lines("fit", 0, 6)
    assert len(said) == 3


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shells_complete_commands(shell):
    told = {**ENVIRONMENT, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}  # the shell is an argument then
    command = [*COMMAND, "--show-completion", shell]
    shown = subprocess.run(command, env=told, capture_output=True, text=True, check=True).stdout
    assert "meshslam" in shown
