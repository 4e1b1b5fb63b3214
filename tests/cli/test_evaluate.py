"""`evaluate`: figures against truth, of runs and of paths of other programs."""

import json

import numpy as np
import pytest

from meshslam.maps import Trajectory
from tests.cli.conftest import done, error_of, meshslam


def test_a_run_is_measured_against_the_recording_that_it_names(source_run):
    found = json.loads(done("evaluate", source_run, "--json").stdout)
    public = json.loads((source_run / "metrics.json").read_text())
    for key in ("voxel_iou_mean", "recall", "centre_error_median_m"):
        assert found["figures"][key] == pytest.approx(public[key], abs=1e-6)
    reasons = {p["name"]: p["not_computed"] for p in found["protocols"] if "not_computed" in p}
    assert "segments are 100 m and longer" in reasons["kitti-odometry"]


def test_a_path_that_was_given_is_not_measured(source_run, street):
    (street / "groundtruth.tum").unlink()
    found = json.loads(done("evaluate", source_run, "--truth", street, "--json").stdout)
    reasons = {p["name"]: p["not_computed"] for p in found["protocols"] if "not_computed" in p}
    assert reasons["ate"].startswith("the run took the recording's own poses as given")
    assert found["figures"]["recall"] > 0


def test_the_table_says_what_was_not_computed(source_run, source, tmp_path):
    files = [tmp_path / "out" / f"figures.{ending}" for ending in ("csv", "json", "md", "tex")]
    flags = [word for file in files for word in ("--out", file)]
    said = done("evaluate", source_run, "--truth", source, "--protocol", "objects", "--protocol", "calibration", *flags)
    assert "voxel_iou_mean" in said.stdout
    assert "calibration-path: " in said.stdout
    assert all(file.stat().st_size > 100 for file in files)


def test_paths_are_measured_as_evo_users_expect(tmp_path, rng):
    path = Trajectory.load(_straight(tmp_path / "truth.tum"))
    path.save(tmp_path / "estimate.tum")
    said = done("evaluate", "--trajectory", tmp_path / "estimate.tum", "--truth", tmp_path / "truth.tum").stdout
    assert "ate_se3_rmse_m" in said
    assert "kitti_t_rel_percent" in said
    assert "poses: 300 paired within 0.005 s; without a partner: 0 true, 0 estimated" in said


def test_mistakes_are_told(tmp_path, source_run):
    truth = _straight(tmp_path / "truth.tum")
    assert "no such run directory" in error_of(meshslam("evaluate", tmp_path / "nowhere", "--truth", truth))
    assert "no such truth" in error_of(meshslam("evaluate", source_run, "--truth", tmp_path / "nowhere"))
    assert "nothing to measure" in error_of(meshslam("evaluate", "--truth", truth))
    assert "give --truth" in error_of(meshslam("evaluate", "--trajectory", truth))
    assert "its ending says the format" in error_of(meshslam("evaluate", source_run, "--out", tmp_path / "a.xls"))
    assert "no such protocol" in error_of(meshslam("evaluate", source_run, "--protocol", "speed"))
    (tmp_path / "empty").mkdir()
    assert "no run: expected" in error_of(meshslam("evaluate", tmp_path / "empty", "--truth", truth))
    (tmp_path / "bad.tum").write_text("0 0 0\n")
    assert "bad.tum" in error_of(meshslam("evaluate", "--trajectory", tmp_path / "bad.tum", "--truth", truth))
    late = meshslam("evaluate", source_run, "--truth", truth, "--protocol", "ate")
    assert (late.returncode, "no estimated pose is within" in late.stdout) == (3, True)


def _straight(path):
    """300 poses, 1 m apart; the times are those of no recording."""
    rows = np.zeros((300, 8))
    rows[:, 0], rows[:, 1], rows[:, 7] = 5000 + 0.1 * np.arange(300), np.arange(300), 1
    np.savetxt(path, rows, fmt="%.6f")
    return path
