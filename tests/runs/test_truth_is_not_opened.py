"""No estimate opens a truth file: every file that a process opens is watched, also one that is read and ignored."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from meshslam.categories import load_category
from meshslam.maps import Map
from meshslam.simulation import StreetConfig, make_street, write_recording

SMALL = StreetConfig(frames=6, width_px=320, height_px=100, focal_px=190.0, cars_each_side=2, speed_m_s=15.0)
ESTIMATING = ("open", "check", "map_drive", "localize", "slam")
RUNS = {"run_map": True, "run_localize": False, "run_slam": True}  # whether objects are scored
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(make_street(load_category("car"), 1, SMALL), tmp_path_factory.mktemp("truth") / "street")


@pytest.fixture(scope="module")
def scene(recording, tmp_path_factory):
    """The true map, which is no truth file of the recording."""
    folder = tmp_path_factory.mktemp("scene")
    Map.load(recording / "objects.json").save(folder)
    return folder


@pytest.fixture(scope="module")
def watched(recording, scene, tmp_path_factory):
    """Run stages in a process that watches itself; of each, the truth files that it opened, and when."""

    def run(stages, *spoiled):
        out = tmp_path_factory.mktemp("runs")
        told = recording, scene, out, ",".join(stages), *spoiled
        command = [sys.executable, "-m", "tests.runs.watched", *map(str, told)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        result = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stderr
        rows = [json.loads(line) for line in result.stdout.splitlines() if line.startswith("{")]
        assert [row["stage"] for row in rows] == list(stages)
        return {row["stage"]: row for row in rows}

    return run


@pytest.fixture(scope="module")
def estimates(watched):
    return watched(ESTIMATING)


@pytest.fixture(scope="module")
def runs(watched):
    return watched(RUNS)


@pytest.mark.parametrize("stage", ESTIMATING)
def test_what_estimates_opens_no_truth(estimates, stage):
    assert estimates[stage]["opened"] == []


@pytest.mark.parametrize("stage", RUNS)
def test_a_run_opens_truth_only_once_its_estimate_is_on_the_disk(runs, stage):
    assert runs[stage]["is_on_disk"]
    assert all(was_on_disk for _, was_on_disk in runs[stage]["opened"])


@pytest.mark.parametrize(("stage", "scores_objects"), RUNS.items())
def test_evaluation_is_seen_to_open_it(runs, stage, scores_objects):
    """The watch sees what is opened: else the tests above would say nothing."""
    names = {name for name, _ in runs[stage]["opened"]}
    assert names >= ({"groundtruth.tum", "objects.json", "association.json"} if scores_objects else {"groundtruth.tum"})


@pytest.mark.parametrize(
    ("stage", "reader"),
    [
        ("open", "meshslam.sequences.folder:read_tum:groundtruth.tum"),
        ("map_drive", "meshslam.sequences.folder:read_times:objects.json"),
        ("map_drive", "meshslam.runs.map_run:perceive:association.json"),
        ("run_map", "meshslam.mapping.pipeline:make_scene:objects.json"),
    ],
)
def test_a_reader_that_reads_truth_and_ignores_it_is_found(watched, stage, reader):
    opened = watched((stage,), reader)[stage]["opened"]
    assert [reader.rsplit(":", 1)[1], False] in opened
