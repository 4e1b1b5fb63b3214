"""A few steps of each command under faults; scripts/fault_sweep.py takes every step (FAULT_STEPS=all does so here)."""

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest

from meshslam.files import LOCK, locked
from tests.faults.harness import Zygote, contents, disturb, undisturbed
from tests.faults.inputs import cases_of

pytestmark = pytest.mark.xdist_group("faults")
NAMES = (
    "map",
    "map --overwrite",
    "localize",
    "localize --overwrite",
    "slam",
    "slam --overwrite",
    "simulate",
    "simulate --overwrite",
    "category build",
    "category build over a file",
    "models add",
)
NOBODY = 65534  # a user id
FAULTS = {name: ["kill"] for name in NAMES} | {
    "map --overwrite": ["kill", "full", "interrupt"],
    "category build over a file": ["kill", "full"],
    "models add": ["kill", "full"],
}


@pytest.fixture(scope="module")
def zygote(tmp_path_factory):
    made = Zygote(tmp_path_factory.mktemp("zygote"))
    yield made
    made.close()


@pytest.fixture(scope="module")
def memory(tmp_path_factory):
    return tmp_path_factory.mktemp("memory")


@pytest.fixture(scope="module")
def cases(zygote, memory, tmp_path_factory):
    return {case.name: case for case in cases_of(tmp_path_factory.mktemp("cases"), zygote, memory)}


def steps_of(count):
    """The steps to try: three that lie apart, or all."""
    return range(1, count + 2) if os.environ.get("FAULT_STEPS") == "all" else sorted({count // 3, count - 1})


@pytest.mark.parametrize("name", NAMES)
def test_whatever_ends_a_command_nothing_is_lost_or_mixed(cases, zygote, memory, name):
    case = cases[name]
    count = undisturbed(zygote, case, memory)
    for fault in FAULTS[name]:
        for at in steps_of(count):
            disturb(zygote, case, at, fault, memory)


def test_two_at_once_the_second_is_refused_and_changes_nothing(cases, zygote, memory):
    for name in ("map --overwrite", "simulate --overwrite"):
        case = cases[name]
        case.prepare()
        inside = case.target / LOCK
        lock = inside if name.startswith("map") else case.target.with_name(f".{case.target.name}{LOCK}")
        with locked(lock, "held"):
            code, _ = zygote.run(case.arguments, memory=memory)
        assert code == 2
        assert f"process {os.getpid()} is writing it" in zygote.said
        assert contents(case.target) == contents(case.old)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root becomes another user")
def test_another_user_changes_nothing_and_is_told_in_one_line(cases, zygote):
    case = cases["map --overwrite"]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        drive, run = shutil.copytree(case.arguments[1], folder / "drive"), shutil.copytree(case.old, folder / "run")
        before, first = contents(run), ["map", drive, "--out", folder / "first"]
        for more in ([], ["--overwrite"]):
            code, _ = zygote.run(["map", drive, "--out", run, *more], uid=NOBODY, first=first)
            assert (code, zygote.said) == (2, f"error: {run}: cannot be written: Permission denied\n")
            assert contents(run) == before
        code, _ = zygote.run(["simulate", folder / "sim"], uid=NOBODY, first=first)
        assert (code, zygote.said) == (2, f"error: {folder}: cannot be written: Permission denied\n")
        (drive / "detections.json").chmod(0o600)
        folder.chmod(0o777)
        code, _ = zygote.run(["map", drive, "--out", folder / "other"], uid=NOBODY, first=first)
        assert code == 2
        assert "detections.json" in zygote.said
        assert "Permission denied" in zygote.said


FILES = {  # the first that is larger, of `simulate` and of `map`
    50: (r"\S*meshslam-lock", r"\S*meshslam-lock"),
    250: ("camera.yaml", "config.yaml"),
    4500: ("detections.json", "detections.json"),
}


@pytest.mark.parametrize("limit_bytes", [50, 250, 4500])
def test_a_file_that_the_disk_does_not_take_is_named(cases, tmp_path, limit_bytes):
    def limited():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # write() then fails, as on a full disk, with no name
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))

    drive = cases["map"].arguments[1]
    for arguments, file in (
        (["simulate", tmp_path / "sim", "--frames", "2"], FILES[limit_bytes][0]),
        (["map", drive, "--out", tmp_path / "run"], FILES[limit_bytes][1]),
    ):
        command = [sys.executable, "-m", "meshslam", *map(str, arguments)]
        ended = subprocess.run(command, capture_output=True, text=True, preexec_fn=limited, check=False)
        assert ended.returncode == 2, ended.stderr
        assert re.search(rf"error: .*/{file}: cannot be written: File too large\n$", ended.stderr), ended.stderr
    assert not (tmp_path / "sim").exists()


def moved(poses):
    """The poses, the first a millimetre higher."""
    time_s, x, y, z, *rest = poses.split()
    return " ".join([time_s, x, y, str(float(z) + 1e-3), *rest[:4]]) + poses[poses.index("\n") :]


CHANGES = (
    ("detections.json", "detections", lambda text: text.replace('"score": 0.', '"score": 0.1', 1)),
    ("poses.tum", "camera poses", moved),
    ("objects.json", "truth", lambda text: text + " "),
)


def test_a_run_whose_input_has_changed_is_refused_by_name(cases, zygote, memory):
    case = replace(cases["map"])
    case.prepare()
    drive = case.arguments[1]
    code, _ = zygote.run(case.arguments, memory=memory)
    assert code == 0, zygote.said
    code, steps = zygote.run(case.arguments)
    assert code == 0, zygote.said
    for name, called, change in CHANGES:
        before = (drive / name).read_text()
        (drive / name).write_text(change(before))
        code, _ = zygote.run(case.arguments)
        (drive / name).write_text(before)
        assert code == 2, zygote.said
        assert f"a run of other input is here ({called})" in zygote.said
        assert "--overwrite" in zygote.said
    assert zygote.run(case.arguments) == (0, steps)


def test_nothing_mapped_is_exit_code_3_with_the_commonest_reason(cases, zygote, tmp_path):
    drive, settings = cases["map"].arguments[1], tmp_path / "settings.yaml"
    settings.write_text("mapping: {min_box_px: 5000.0}\n")
    code, _ = zygote.run(["map", drive, "--out", tmp_path / "run", "--config", settings])
    assert code == 3
    assert "0 objects mapped" in zygote.said
    assert "too_small" in zygote.said
    assert "too_small" in (tmp_path / "run" / "left_out.json").read_text()
    assert "0 objects mapped" in (tmp_path / "run" / "metrics.json").read_text()
    again, _ = zygote.run(["map", drive, "--out", tmp_path / "run", "--config", settings])
    assert again == 3
    assert "0 objects mapped" in zygote.said
