"""Whatever ends a run, what it wrote is whole, and the same command again ends as if nothing had happened."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
import trimesh

from meshslam.maps import Map, Trajectory
from meshslam.perception import read_detections
from meshslam.sequences.folder import read_camera_file
from meshslam.sequences.report import Report
from tests.cli.conftest import begin, done, estimate, meshslam

READERS = {
    "map.json": lambda path: Map.load(path.parent),
    "trajectory.tum": Trajectory.load,
    "detections.json": read_detections,
    "camera.yaml": lambda path: read_camera_file(path, Report()),
    "metrics.json": lambda path: json.loads(path.read_text()),
    "map.glb": lambda path: trimesh.load(path),
    "report.html": lambda path: path.read_text().index("</html>"),
}


def assert_whole(run):
    """Read every file that has a final name."""
    for name, read in READERS.items():
        if (run / name).exists():
            read(run / name)


def wait_for(process, condition, timeout_s=120):
    end = time.monotonic() + timeout_s
    while not condition() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.005)


def kill(process, how):
    os.killpg(process.pid, how)
    return process.communicate(timeout=60)


MOMENTS = {
    "imports": lambda run: True,
    "perception": lambda run: (run / "config.yaml").exists(),
    "mapping": lambda run: (run / "detections.json").exists(),
    "saving": lambda run: (run / "trajectory.tum").exists(),
    "saved": lambda run: (run / "map.json").exists(),
    "reporting": lambda run: (run / "map.glb").exists(),
}


@pytest.mark.data
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_killed_run_is_taken_up_again(four_frames, four_frames_run, network, tmp_path, moment):
    run = tmp_path / "run"
    command = ("map", four_frames, "--segmenter", network, "--out", run)
    process = begin(*command)
    wait_for(process, lambda: MOMENTS[moment](run))
    time.sleep(0.02)
    kill(process, signal.SIGKILL)
    assert_whole(run)
    done(*command)
    assert_whole(run)
    assert estimate(run) == estimate(four_frames_run)
    for name in ("detections.json", "camera.yaml", "map.glb"):
        assert (run / name).read_bytes() == (four_frames_run / name).read_bytes()
    assert {p.name for p in run.iterdir()} == {p.name for p in four_frames_run.iterdir()}
    assert not list(run.rglob("*.meshslam-part"))


@pytest.mark.parametrize("moment", ["perception", "saving"])
def test_ctrl_c_ends_with_130_and_leaves_only_whole_files(source, source_run, tmp_path, moment):
    run = tmp_path / "run"
    process = begin("map", source, "--out", run)
    wait_for(process, lambda: MOMENTS[moment](run))
    if process.poll() is None:
        _, errors = kill(process, signal.SIGINT)
        if process.returncode != 0:  # else it had ended by itself
            assert process.returncode == 130
            assert "Traceback" not in errors
            assert "interrupted" in errors
    assert_whole(run)
    assert not list(run.rglob("*.meshslam-part"))
    done("map", source, "--out", run)
    assert estimate(run) == estimate(source_run)


def test_a_disk_that_takes_nothing_is_one_error(source, tmp_path):
    if os.geteuid() == 0:
        target = "/proc/nothing"  # the superuser may write anywhere else
    else:
        target = tmp_path / "shut"
        target.mkdir(mode=0o500)
    result = meshslam("map", source, "--out", target)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
    assert str(target) in result.stderr


@pytest.mark.data
def test_masks_of_a_run_are_those_that_detect_writes(four_frames, four_frames_run, network, tmp_path):
    done("detect", four_frames, "--segmenter", network, "--out", tmp_path / "found.json")
    plain = json.loads((tmp_path / "found.json").read_text())
    tracked = json.loads((four_frames_run / "detections.json").read_text())
    assert len(plain["annotations"]) > 10
    for annotation in tracked["annotations"]:
        annotation.pop("track_id", None)
    assert tracked == plain


@pytest.mark.data
def test_detections_of_a_file_give_the_map_of_the_network(four_frames, four_frames_run, network, tmp_path):
    done("detect", four_frames, "--segmenter", network, "--out", tmp_path / "found.json")
    done("map", four_frames, "--detections", tmp_path / "found.json", "--out", tmp_path / "run")
    assert estimate(tmp_path / "run") == estimate(four_frames_run)


def test_ctrl_c_while_the_commands_are_imported_is_told(tmp_path):
    """An import that never ends stands for a slow disk."""
    (tmp_path / "typer.py").write_text("import time\nprint('importing', flush=True)\ntime.sleep(60)\n")
    command = [sys.executable, "-m", "meshslam", "version"]
    path = os.pathsep.join([str(tmp_path), *sys.path])
    environment = {**os.environ, "PYTHONPATH": path}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    assert process.stdout.readline() == "importing\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (130, "interrupted: nothing was begun\n")


def test_ctrl_c_after_the_last_step_changes_nothing():
    """Python restores the system's handler of signals while it ends: what goes last then stands for a slow end."""
    script = (
        "import os, signal, sys\n"
        "class Last:\n"
        "    def __del__(self, kill=os.kill, pid=os.getpid(), number=signal.SIGINT):\n"
        "        kill(pid, number)\n"
        "sys.last = Last()\n"
        "sys.argv = ['meshslam', 'version']\n"
        "from meshslam.cli import main\n"
        "main()\n"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
