"""Small drives, and a fleet as users run it."""

import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
import yaml

from meshslam.categories import load_category
from meshslam.simulation import StreetConfig, make_street, write_recording
from tests.faults.harness import contents
from tests.perception.networks import colour_network

SMALL = StreetConfig(frames=6, width_px=320, height_px=100, focal_px=190.0, cars_each_side=1, speed_m_s=15.0)
COMMAND = (sys.executable, "-m", "meshslam")
NAMES = ("street_1", "street_2", "slam_3", "network_4")
POISONED, BAD_IMAGE = "poisoned", "bad_image"


@pytest.fixture(scope="session")
def recordings(tmp_path_factory):
    """Two streets to map, one for SLAM, one with a network and images; a poisoned one, one with a bad image."""
    folder = tmp_path_factory.mktemp("drives")
    category = load_category("car")
    colour_network(folder / "net.onnx")
    for seed, name in enumerate((*NAMES, BAD_IMAGE), 1):
        made = write_recording(make_street(category, seed, SMALL), folder / "drives" / name)
        if name in (NAMES[3], BAD_IMAGE):
            (made / "detections.json").unlink()
        else:
            shutil.rmtree(made / "images")
    image = sorted((folder / "drives" / BAD_IMAGE / "images").iterdir())[3]
    image.write_bytes(image.read_bytes()[:200])
    (folder / "drives" / POISONED).mkdir()
    (folder / "drives" / POISONED / "camera.yaml").write_text("model: what\n")
    return folder


def entry(name):
    """A drive of the fleet file."""
    of_slam = {"command": "slam"} if name.startswith("slam") else {}
    by_network = {"settings": {"input": {"segmenter": "net.onnx"}}} if name in (NAMES[3], BAD_IMAGE) else {}
    return {"name": name, "recording": f"drives/{name}", **of_slam, **by_network}


@pytest.fixture(scope="session")
def fleet_file(recordings):
    """All of them, the two that fail among the others."""
    names = (NAMES[0], POISONED, NAMES[1], BAD_IMAGE, *NAMES[2:])
    path = recordings / "fleet.yaml"
    path.write_text(yaml.safe_dump({"drives": [entry(name) for name in names]}, sort_keys=False))
    return path


@pytest.fixture(scope="session")
def few_file(recordings):
    """Two streets."""
    path = recordings / "few.yaml"
    path.write_text(yaml.safe_dump([entry(name) for name in NAMES[:2]]))
    return path


SINGLES = """
import sys
from pathlib import Path
from meshslam.cli.app import one_blas_thread
one_blas_thread()
from meshslam.runs import RUNS, Config, Outlet, overlaid
folder, out = map(Path, sys.argv[1:3])
for name in sys.argv[3:]:
    network = {"segmenter": str(folder / "net.onnx")} if name.startswith("network") else {}
    settings = overlaid(Config(), {"input": {"sequence": str(folder / "drives" / name), **network}}, "test")
    RUNS["slam" if name.startswith("slam") else "map"](settings, out / name, Outlet(), overwrite=False)
"""


@pytest.fixture(scope="session")
def singles(recordings, tmp_path_factory):
    """What single runs write, by drive: the first by the command, the others as the command does."""
    folder, first = tmp_path_factory.mktemp("singles"), NAMES[0]
    by_command = [*COMMAND, "map", str(recordings / "drives" / first), "--out", str(folder / first)]
    others = [sys.executable, "-c", SINGLES, str(recordings), str(folder), *NAMES[1:]]
    for command in (by_command, others):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return folder


def run_fleet(*arguments, timeout_s=240, **environment):
    """`meshslam fleet run`, to its end."""
    command = [*COMMAND, "fleet", "run", *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=timeout_s, env={**os.environ, **environment}, check=False
    )


def begin_fleet(log, *arguments, **environment):
    """`meshslam fleet run` with what it says in a file."""
    with log.open("wb") as file:
        command = [*COMMAND, "fleet", "run", *map(str, arguments)]
        given = {**os.environ, **environment}
        return subprocess.Popen(command, stdout=file, stderr=file, env=given, start_new_session=True)


def assert_equal_to_singles(out, singles, names=NAMES):
    """Good drives are there, to the bytes of their single runs."""
    for name in names:
        assert contents(out / "runs" / name) == contents(singles / name), name


def states_of(found):
    """How each drive ended, from fleet.json."""
    return {drive["name"]: drive["how"] for drive in found["drives"]}


def seen(condition, timeout_s=120.0):
    """What a condition gives as soon as it gives something."""
    end_s = time.monotonic() + timeout_s
    while time.monotonic() < end_s:
        found = condition()
        if found:
            return found
        time.sleep(0.005)
    raise AssertionError("it did not happen")


def end(process, how=signal.SIGINT):
    """Signal a command and wait for it: its exit code."""
    process.send_signal(how)
    return process.wait(timeout=60)
