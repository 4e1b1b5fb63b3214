"""The entry script for VSLAM-LAB, on a drawn street in its layout."""

import csv
import subprocess
import sys

import numpy as np
import pytest
import yaml

from meshslam.categories import load_category
from meshslam.maps import Trajectory
from meshslam.sequences import open_sequence
from meshslam.simulation import StreetConfig, make_street, write_recording
from tests.conftest import REPOSITORY

SCRIPT = REPOSITORY / "packaging" / "vslam_lab" / "vslamlab_meshslam_mono.py"
STREET = StreetConfig(frames=40, width_px=400, height_px=130, focal_px=230.0)
BEGIN_NS = 1_403_636_579_763_555_584


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """rgb_0/, rgb.csv and calibration.yaml, as VSLAM-LAB has them."""
    street, folder = tmp_path_factory.mktemp("street"), tmp_path_factory.mktemp("lab")
    write_recording(make_street(load_category("car"), 3, STREET), street)
    drive = open_sequence(street)
    (folder / "rgb_0").symlink_to(street / "images")
    rows = [
        (BEGIN_NS + round(1e9 * (time_s - drive.times_s[0])), f"rgb_0/{path.name}")
        for time_s, path in zip(drive.times_s, sorted((street / "images").iterdir()), strict=True)
    ]
    with (folder / "rgb.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("ts_rgb_0 (ns)", "path_rgb_0"), *rows])
    camera = drive.camera
    lens = {
        "cam_name": "rgb_0",
        "cam_type": "rgb",
        "cam_model": "pinhole",
        "focal_length": [camera.fx, camera.fy],
        "principal_point": [camera.cx, camera.cy],
        "fps": 10.0,
    }
    (folder / "calibration.yaml").write_text("%YAML 1.2\n---\n" + yaml.safe_dump({"cameras": [lens]}))
    return folder, rows


def test_every_frame_of_the_experiment_gets_a_pose_with_its_own_time(sequence, tmp_path):
    folder, rows = sequence
    (tmp_path / "settings.yaml").write_text("segmenter: colour\n")
    with (tmp_path / "rgb_exp.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("ts_rgb_0 (ns)", "path_rgb_0"), *rows[:36]])  # an experiment may use a part
    given = {
        "sequence_path": folder,
        "calibration_yaml": folder / "calibration.yaml",
        "rgb_csv": tmp_path / "rgb_exp.csv",
        "exp_folder": tmp_path,
        "exp_it": 7,
        "settings_yaml": tmp_path / "settings.yaml",
        "verbose": 1,
        "mode": "mono",
    }
    flags = [text for name, value in given.items() for text in (f"--{name}", str(value))]
    subprocess.run([sys.executable, SCRIPT, *flags], check=True, timeout=600)
    with (tmp_path / "00007_KeyFrameTrajectory.csv").open(newline="") as file:
        header, *found = csv.reader(file)
    assert header == ["ts (ns)", "tx (m)", "ty (m)", "tz (m)", "qx", "qy", "qz", "qw"]
    assert [int(row[0]) for row in found] == [time_ns for time_ns, _ in rows[:36]]
    path = Trajectory.load(tmp_path / "meshslam_00007" / "run" / "trajectory.tum")
    np.testing.assert_allclose(np.array(found)[:, 1:4].astype(float), path.positions_in_world, atol=1e-9)
    assert np.linalg.norm(path.positions_in_world[-1] - path.positions_in_world[0]) > 5.0
