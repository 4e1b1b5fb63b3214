"""The local engine: the bytes of single runs, drives that fail alone, workers that are lost, and nothing done twice."""

import json
import signal
import time
from pathlib import Path

import pytest
import yaml

from meshslam.files import LOCK
from tests.faults.harness import contents
from tests.fleet.conftest import (
    BAD_IMAGE,
    NAMES,
    POISONED,
    assert_equal_to_singles,
    begin_fleet,
    end,
    entry,
    run_fleet,
    seen,
    states_of,
)
from tests.fleet.killing import killed_in_the_middle, writers


@pytest.fixture(scope="module")
def whole(fleet_file, tmp_path_factory):
    """A fleet that nothing has disturbed: its folder, and the command's result."""
    out = tmp_path_factory.mktemp("fleet") / "out"
    return out, run_fleet(fleet_file, "--out", out, "--workers", "2")


def tell(out):
    return json.loads((out / "fleet.json").read_text())


def stamps(out):
    """When each file of the runs was written, those that are one of a kind."""
    return {str(path): path.stat().st_mtime_ns for path in (out / "runs").rglob("*") if path.is_file()}


def test_every_run_has_the_bytes_of_a_single_run(whole, singles):
    assert_equal_to_singles(whole[0], singles)


def test_drives_that_are_wrong_fail_alone_with_their_reasons(whole):
    out, result = whole
    assert result.returncode == 1
    assert states_of(tell(out)) == dict.fromkeys(NAMES, "done") | {POISONED: "failed", BAD_IMAGE: "failed"}
    reasons = {drive["name"]: drive["reason"] for drive in tell(out)["drives"]}
    assert "camera.yaml: model: expected pinhole, found 'what'" in reasons[POISONED]
    assert "000003" in reasons[BAD_IMAGE]
    assert f"failed: {POISONED}: {reasons[POISONED]}" in result.stdout
    assert "Traceback" not in result.stderr
    assert [drive["attempts"] for drive in tell(out)["drives"]] == [1] * 6


def test_steps_are_tasks_of_their_own(whole):
    steps = {drive["name"]: [task["step"] for task in drive["tasks"]] for drive in tell(whole[0])["drives"]}
    assert steps["street_1"] == ["detect", "map"]
    assert steps["slam_3"] == ["detect", "slam"]
    assert steps["network_4"] == ["detect", "track", "map"]
    assert steps[POISONED] == steps[BAD_IMAGE] == ["detect"]


def test_run_again_nothing_is_computed(whole, fleet_file):
    out, _ = whole
    before = stamps(out)
    result = run_fleet(fleet_file, "--out", out)
    assert result.returncode == 1
    assert states_of(tell(out)) == dict.fromkeys(NAMES, "unchanged") | {POISONED: "failed", BAD_IMAGE: "failed"}
    assert {path: time for path, time in stamps(out).items() if f"/{BAD_IMAGE}/" not in path} == {
        path: time for path, time in before.items() if f"/{BAD_IMAGE}/" not in path
    }


def test_a_worker_that_is_killed_is_replaced(few_file, singles, tmp_path):
    out, log = tmp_path / "out", tmp_path / "log"
    process = begin_fleet(log, few_file, "--out", out, "--workers", "2")
    name = seen(lambda: killed_in_the_middle(out, NAMES))
    assert process.wait(timeout=240) == 0
    assert_equal_to_singles(out, singles, NAMES[:2])
    by_name = {drive["name"]: drive for drive in tell(out)["drives"]}
    assert by_name[name]["attempts"] == 2
    assert [drive["attempts"] for drive in by_name.values() if drive["name"] != name] == [1]
    assert "was killed by SIGKILL" in log.read_text()
    lost = [task for task in by_name[name]["tasks"] if task["how"].startswith("lost")]
    assert len(lost) == 1


def test_without_retries_a_lost_worker_fails_its_drive_alone(few_file, tmp_path):
    out, log = tmp_path / "out", tmp_path / "log"
    process = begin_fleet(log, few_file, "--out", out, "--workers", "1", "--retries", "0")
    name = seen(lambda: killed_in_the_middle(out, NAMES))
    assert process.wait(timeout=240) == 1
    assert [n for n, how in states_of(tell(out)).items() if how == "done"] == [n for n in NAMES[:2] if n != name]


def test_ctrl_c_ends_with_130_and_the_next_run_goes_on(few_file, singles, tmp_path):
    out, log = tmp_path / "out", tmp_path / "log"
    process = begin_fleet(log, few_file, "--out", out, "--workers", "1")
    workers = seen(lambda: writers(out))
    assert end(process) == 130
    assert "goes on from there" in log.read_text()
    assert "Traceback" not in log.read_text()
    assert not writers(out)
    assert not list(out.rglob("*.meshslam-part"))
    for pid in workers.values():
        assert not Path(f"/proc/{pid}").exists()
    assert "not run" in states_of(tell(out)).values()
    assert run_fleet(few_file, "--out", out, "--workers", "1").returncode == 0
    assert_equal_to_singles(out, singles, NAMES[:2])


def test_workers_end_with_their_driver(few_file, tmp_path):
    out, log = tmp_path / "out", tmp_path / "log"
    process = begin_fleet(log, few_file, "--out", out, "--workers", "1")
    workers = seen(lambda: writers(out))
    end(process, signal.SIGKILL)
    seen(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers.values()), 20)


def test_a_second_fleet_in_the_folder_is_refused(few_file, tmp_path):
    out, log = tmp_path / "out", tmp_path / "log"
    process = begin_fleet(log, few_file, "--out", out, "--workers", "1")
    seen(lambda: (out / LOCK).exists() and str(process.pid) in (out / LOCK).read_text())
    time.sleep(0.5)  # its writer lets go of the lock file: stopped before, it would keep all others waiting
    process.send_signal(signal.SIGSTOP)
    second = run_fleet(few_file, "--out", out)
    process.send_signal(signal.SIGCONT)
    end(process)
    assert second.returncode == 2
    assert f"process {process.pid} is writing it" in second.stderr


def test_without_a_shared_folder_files_are_carried_to_the_same_bytes(recordings, singles, tmp_path):
    names, out, file = (NAMES[1], NAMES[3]), tmp_path / "out", recordings / "carried.yaml"
    file.write_text(yaml.safe_dump([entry(name) for name in (*names, POISONED)]))
    assert run_fleet(file, "--out", out, "--no-shared-folder", "--workers", "2").returncode == 1
    assert_equal_to_singles(out, singles, names)
    before = stamps(out)
    assert run_fleet(file, "--out", out, "--no-shared-folder").returncode == 1
    assert stamps(out) == before
    assert set(states_of(tell(out)).values()) == {"unchanged", "failed"}


def test_recordings_and_results_may_be_urls(recordings, singles, tmp_path):
    pytest.importorskip("fsspec")
    file, name = tmp_path / "urls.yaml", NAMES[0]
    file.write_text(f"- file://{recordings}/drives/{name}\n- file://{recordings}/drives/none\n")
    for how in ("done", "unchanged"):
        result = run_fleet(file, "--out", f"file://{tmp_path}/out", "--workers", "1")
        assert result.returncode == 1, result.stderr
        assert states_of(tell(tmp_path / "out")) == {name: how, "none": "failed"}
    got, expected = contents(tmp_path / "out" / "runs" / name), contents(singles / name)
    assert {k: v for k, v in got.items() if k != "config.yaml"} == {
        k: v
        for k, v in expected.items()
        if k != "config.yaml"  # it names the recording's place
    }
    assert "none: no such folder or file" in result.stdout
