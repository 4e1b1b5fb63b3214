"""A run that is logged gives the result of one that is not, and leaves whole files however it ends."""

import os
import signal
import time
import urllib.request

import pytest
from mcap.reader import make_reader
from rerun.chunk import RrdReader

from meshslam.cli.viewers import Viewers
from meshslam.errors import ConfigError
from meshslam.maps import Map
from tests.cli.conftest import ENVIRONMENT, begin, done, estimate


def logged(folder):
    """Entities and frames in run.rrd, topics and messages in run.mcap: both are complete."""
    chunks = list(RrdReader(folder / "run.rrd").stream())  # warns if it has no footer: an error in tests
    with (folder / "run.mcap").open("rb") as file:
        reader = make_reader(file)
        counts = {channel.topic: 0 for channel in reader.get_summary().channels.values()}
        for _, channel, _ in reader.iter_messages():
            counts[channel.topic] += 1
    return {str(chunk.entity_path) for chunk in chunks}, counts


def test_a_logged_run_gives_the_same_map_and_both_files_hold_it(source, source_run, tmp_path):
    flags = ("--rrd", tmp_path / "run.rrd", "--mcap", tmp_path / "run.mcap", "--colour", "sigma")
    done("map", source, "--out", tmp_path / "run", *flags)
    assert estimate(tmp_path / "run") == estimate(source_run)
    assert (tmp_path / "run" / "config.yaml").read_bytes() == (source_run / "config.yaml").read_bytes()
    entities, counts = logged(tmp_path)
    cars = {f"/world/result/objects/car_{number}" for number in Map.load(source_run)}
    assert {name for name in entities if name.startswith("/world/result/objects/")} == cars
    assert counts["/camera/image"] == 6
    assert counts["/result/objects"] == 1


def test_a_run_leaves_its_recording_unless_it_is_told_not_to(source, source_run, tmp_path, monkeypatch):
    assert not (source_run / "recording.rrd").exists()  # the tests' MESHSLAM_RECORDING is 0
    monkeypatch.setitem(ENVIRONMENT, "MESHSLAM_RECORDING", "1")
    done("map", source, "--out", tmp_path / "run")
    names = {str(chunk.entity_path) for chunk in RrdReader(tmp_path / "run" / "recording.rrd").stream()}
    assert {f"/world/result/objects/car_{number}" for number in Map.load(source_run)} <= names


def test_ctrl_c_leaves_whole_files(source, tmp_path):
    flags = ("--rrd", tmp_path / "run.rrd", "--mcap", tmp_path / "run.mcap")
    process = begin("map", source, "--out", tmp_path / "run", *flags)
    end = time.monotonic() + 60
    while not (tmp_path / "run.mcap").exists() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 130
    entities, _ = logged(tmp_path)
    assert "/world" in entities


def test_wrong_uses_end_before_the_run_begins(source, tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    run = tmp_path / "run"
    for viewers, message in (
        (Viewers(False, False, None, None, "sigma"), "--colour is of"),
        (Viewers(False, False, run / "recording.rrd", None, None), "the run writes this file itself"),
        (Viewers(True, False, None, None, None), "no display"),
    ):
        with pytest.raises(ConfigError, match=message), viewers.opened(run, overwrite=True):
            raise AssertionError("the run began")
    assert not run.exists()


def test_a_page_is_served_until_ctrl_c(source, source_run):
    process = begin("map", source, "--out", source_run, "--serve")
    lines = []
    for line in process.stderr:
        lines.append(line)
        if line.startswith("the run is done"):
            break
    address = lines[0].split()[1]
    assert lines[0].startswith("serving http://127.0.0.1:")
    with urllib.request.urlopen(address, timeout=10) as page:
        assert page.status == 200
    os.killpg(process.pid, signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 0
