"""A run along poses with a wrong step: it is corrected, and the run says so."""

import json
from dataclasses import replace

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.features import LengthConfig
from meshslam.geometry import Pose
from meshslam.maps import Trajectory
from meshslam.runs import Config, InputConfig, Outlet, run_map
from meshslam.simulation import ObserverConfig, StreetConfig, make_street, write_recording

SMALL = StreetConfig(frames=10, width_px=480, height_px=150, focal_px=280.0, cars_each_side=2)
WRONG, RATIO = 5, 1.25


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    street = make_street(load_category("car"), 4, SMALL)
    return write_recording(street, tmp_path_factory.mktemp("lengths"), ObserverConfig())


def mapped(drive, out, **lengths):
    """Map with the poses that are there; the path and the notes."""
    settings = replace(Config(input=InputConfig(sequence=str(drive))), lengths=LengthConfig(**lengths))
    run_map(settings, out, Outlet(frames_in_report=2), overwrite=False)
    return Trajectory.load(out / "trajectory.tum"), json.loads((out / "metrics.json").read_text()).get("notes", [])


def steps_m(path):
    return np.linalg.norm(np.diff([pose.translation for pose in path.world_from_camera], axis=0), axis=1)


def test_right_poses_stay_and_a_wrong_step_is_corrected_and_told(drive, tmp_path):
    right, notes = mapped(drive, tmp_path / "right")
    untouched, _ = mapped(drive, tmp_path / "off", enabled=False)
    assert not [note for note in notes if "camera path" in note]
    assert right.to_tum() == untouched.to_tum()

    given = Trajectory.load(drive / "poses.tum")
    ahead = (RATIO - 1) * (given.world_from_camera[WRONG + 1].translation - given.world_from_camera[WRONG].translation)
    moved = [Pose(p.rotation, p.translation + ahead * (k > WRONG)) for k, p in enumerate(given.world_from_camera)]
    (drive / "poses.tum").write_bytes(Trajectory(given.times_s, tuple(moved)).to_tum())
    found, notes = mapped(drive, tmp_path / "wrong")
    assert steps_m(found) == pytest.approx(steps_m(right), rel=0.03)
    [note] = [note for note in notes if "camera path" in note]
    assert "1 step length corrected" in note
    assert note in (tmp_path / "wrong" / "report.html").read_text()
