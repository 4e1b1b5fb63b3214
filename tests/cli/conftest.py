"""Commands as users run them: in processes of their own."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from meshslam.categories import load_category
from meshslam.simulation import StreetConfig, make_street, write_recording

SMALL = StreetConfig(frames=6, width_px=320, height_px=100, focal_px=190.0, cars_each_side=2, speed_m_s=15.0)
COMMAND = (sys.executable, "-m", "meshslam")
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "2"}


def meshslam(*arguments, timeout_s=240):
    """Run a command to its end."""
    command = [*COMMAND, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, env=ENVIRONMENT, check=False)


def begin(*arguments):
    """Start a command, as a group of its own."""
    command = [*COMMAND, *map(str, arguments)]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, **silent, text=True, env=ENVIRONMENT, start_new_session=True)


def done(*arguments):
    """Run a command that must succeed."""
    result = meshslam(*arguments)
    assert result.returncode == 0, result.stderr
    return result


def error_of(result):
    """The one line that tells what went wrong."""
    assert result.returncode == 2, (result.returncode, result.stdout, result.stderr)
    assert "Traceback" not in result.stderr
    lines = [line for line in result.stderr.splitlines() if not re.search(r"\d/\d+ ", line)]  # less the bars
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("error: ")
    return lines[0]


def score(data_folder, *arguments):
    """Figures by the scorer that is none of our code."""
    script = data_folder.parent / "tools" / "score_run.py"
    result = subprocess.run([sys.executable, script, *arguments], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def case(data_folder, *arguments):
    """Make a case by the script that is none of our code."""
    script = data_folder.parent / "tools" / "make_case.py"
    subprocess.run([sys.executable, script, *map(str, arguments)], capture_output=True, check=True)


def estimate(run):
    """The bytes that must not depend on anything but input and configuration."""
    return tuple((run / name).read_bytes() for name in ("map.json", "trajectory.tum"))


@pytest.fixture(scope="session")
def source(tmp_path_factory):
    """A street of six small frames with truth; not to be changed."""
    return write_recording(make_street(load_category("car"), 1, SMALL), tmp_path_factory.mktemp("source") / "street")


@pytest.fixture
def street(source, tmp_path):
    """A copy of the street to break."""
    return Path(shutil.copytree(source, tmp_path / "street"))


@pytest.fixture(scope="session")
def source_run(source, tmp_path_factory):
    """The undisturbed run of the street."""
    run = tmp_path_factory.mktemp("source_run") / "run"
    done("map", source, "--out", run)
    return run


@pytest.fixture(scope="session")
def network(data_folder):
    """The real segmentation network."""
    return data_folder / "models" / "yolov5n-seg.onnx"


@pytest.fixture(scope="session")
def four_frames(data_folder, tmp_path_factory):
    """Four frames of the real drive 0048, by links."""
    whole = data_folder / "kitti_raw" / "2011_09_26" / "2011_09_26_drive_0048_sync"
    drive = tmp_path_factory.mktemp("kitti") / "2011_09_26" / whole.name
    for file in whole.parent.glob("calib*.txt"):
        drive.mkdir(parents=True, exist_ok=True)
        (drive.parent / file.name).symlink_to(file)
    chosen = sorted((whole / "image_02" / "data").iterdir())[:4]
    (drive / "image_02" / "data").mkdir(parents=True)
    (drive / "oxts" / "data").mkdir(parents=True)
    for image in chosen:
        (drive / "image_02" / "data" / image.name).symlink_to(image)
        (drive / "oxts" / "data" / f"{image.stem}.txt").symlink_to(whole / "oxts" / "data" / f"{image.stem}.txt")
    for part in ("image_02", "oxts"):
        lines = (whole / part / "timestamps.txt").read_text().splitlines()[:4]
        (drive / part / "timestamps.txt").write_text("\n".join(lines) + "\n")
    return drive


@pytest.fixture(scope="session")
def four_frames_run(four_frames, network, tmp_path_factory):
    """The undisturbed run of the four frames."""
    run = tmp_path_factory.mktemp("four") / "run"
    done("map", four_frames, "--segmenter", network, "--out", run)
    return run
