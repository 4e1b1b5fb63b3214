"""`slam --live`: a drawn street through the pipeline, by its clock."""

import json
from dataclasses import replace

import pytest

from meshslam.categories import load_category
from meshslam.maps import Map, Trajectory, TrajectoryEstimate
from meshslam.simulation import ImuNoise, make_street, write_recording
from tests.cli.conftest import SMALL, error_of, meshslam


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    """A street of two seconds with an IMU."""
    street = make_street(load_category("car"), 1, replace(SMALL, frames=20, speed_m_s=6.0))
    return write_recording(street, tmp_path_factory.mktemp("live") / "street", imu_noise=ImuNoise())


def test_a_replay_leaves_a_whole_run_with_counts(moving, tmp_path):
    run = tmp_path / "run"
    told = meshslam("slam", moving, "--segmenter", "colour", "--live", "--rate", "0.5", "--out", run)
    assert told.returncode in (0, 3), told.stderr  # 3: a busy machine saw too little of the cars, which it says
    figures = json.loads((run / "metrics.json").read_text())
    frames = figures["live_frames"]
    assert frames == figures["frames"] == len(Trajectory.load(run / "trajectory.tum"))
    assert figures["live_frames_taken_in"] + figures["live_frames_skipped"] + figures["live_frames_failed"] == frames
    poses = figures["live_poses_by_window"] + figures["live_poses_by_imu"] + figures["live_poses_waiting"]
    assert poses == frames
    assert figures["live_frames_segmented"] > 3
    assert figures["seconds_live"] > 19 / 10 / 0.5  # by the clock, half as fast
    assert "ate_rmse_m" in figures
    assert figures["ate_rmse_m"] < 0.3
    assert len(TrajectoryEstimate.load(run / "trajectory.csv")) == frames
    Map.load(run)


def test_it_says_what_it_needs(moving, street, tmp_path):
    (street / "imu.csv").unlink()
    assert "live SLAM needs an IMU" in error_of(meshslam("slam", street, "--live", "--out", tmp_path / "run"))
    refused = error_of(meshslam("slam", moving, "--live", "--solver", "gradient", "--out", tmp_path / "other"))
    assert "live: " in refused


def test_the_rate_is_that_of_the_clock(moving, tmp_path):
    told = meshslam("slam", moving, "--segmenter", "colour", "--live", "--rate", "4", "--out", tmp_path / "run")
    assert told.returncode in (0, 3), told.stderr  # 3: no car in half a second, which it says
    assert told.returncode == 0 or "objects mapped" in told.stderr
    figures = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert figures["live_frames"] == 20
    assert figures["seconds_live"] > 0.4
