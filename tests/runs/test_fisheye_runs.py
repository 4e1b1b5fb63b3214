"""`localize` and `slam` on a fisheye's recording, against the truth and beside a pinhole camera of the same view."""

import json
from dataclasses import replace

import numpy as np
import pytest

import meshslam
from meshslam.categories import load_category
from meshslam.simulation import EXACT, StreetConfig, make_street, write_recording

FRAMES = 16
FISHEYE = StreetConfig(
    frames=FRAMES, width_px=400, height_px=150, lens="equidistant", field_deg=150.0, cars_each_side=3, speed_m_s=15.0
)
PINHOLE = replace(FISHEYE, lens="pinhole", focal_px=FISHEYE.width_px / float(np.radians(FISHEYE.field_deg)))


@pytest.fixture(scope="module", params=["pinhole", "equidistant"])
def drive(request, tmp_path_factory):
    config = PINHOLE if request.param == "pinhole" else FISHEYE
    street = make_street(load_category("car"), 3, config)
    return write_recording(street, tmp_path_factory.mktemp(request.param) / "drive", EXACT, known_poses=False)


def positions_m(drive):
    rows = np.loadtxt(drive / "groundtruth.tum")
    return rows[:, 1:4]


def test_localize(drive):
    found = meshslam.localize(drive, drive / "objects.json")
    errors_m = np.linalg.norm(found.trajectory.positions_in_world - positions_m(drive), axis=1)
    assert errors_m.max() < 0.03  # 0.007 m with the pinhole camera, 0.008 m with the fisheye
    assert found.figures["views_used"] > 40


def test_slam(drive):
    found = meshslam.slam(drive)
    errors_m = np.linalg.norm(found.trajectory.positions_in_world - positions_m(drive), axis=1)
    assert errors_m.max() < 0.2  # 0.11 m after 15 m with both
    truth = json.loads((drive / "objects.json").read_text())["objects"]
    centres = np.array([np.array(thing["world_from_object"])[:3, 3] for thing in truth])
    off_m = [np.linalg.norm(centres - car.world_from_object.translation, axis=1).min() for car in found.map.values()]
    assert len(off_m) >= 5
    assert max(off_m) < 0.25  # 0.14 m and 0.12 m


def test_without_the_lens_the_camera_is_not_found(drive):
    """The detections' raw pixels are far from the view's: runs that took them for it would be off."""
    recording = meshslam.open_sequence(drive)
    if recording.distortion is None:
        pytest.skip("a pinhole camera")
    unbent = replace(recording, distortion=None)
    errors_m = np.linalg.norm(
        meshslam.localize(unbent, drive / "objects.json").trajectory.positions_in_world - positions_m(drive), axis=1
    )
    assert errors_m.max() > 0.1
