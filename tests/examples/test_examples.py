"""Every program of examples/ runs as a user runs it, and finds what is true."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from meshslam.maps import Map, Trajectory

FOLDER = Path(__file__).resolve().parents[2] / "examples"
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "2"}
CHECKED = {
    "map_a_drive",
    "live_slam",
    "localize_in_a_map",
    "mesh_from_masks",
    "own_category",
    "mask_gradient",
    "fit_a_sphere",  # these two: test_autodiff.py
    "pose_from_a_mask",
}


def run(name, *arguments):
    command = [sys.executable, FOLDER / f"{name}.py", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, env=ENVIRONMENT, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def figure(text, after):
    """The number that stands behind some words."""
    found = re.search(re.escape(after) + r" (-?[\d.]+)", text)
    assert found, text
    return float(found[1])


def test_every_program_is_checked_here_listed_in_the_readme_and_short():
    files = {file.stem: file for file in FOLDER.glob("*.py")}
    assert files.keys() == CHECKED
    readme = (FOLDER / "README.md").read_text(encoding="utf-8")
    for file in files.values():
        assert file.name in readme
        assert len(file.read_text(encoding="utf-8").splitlines()) < 60, file.name


@pytest.mark.parametrize("name", sorted(CHECKED))
def test_the_gallery_shows_every_program_with_its_picture(name):
    docs = FOLDER.parent / "docs"
    page = (docs / "examples.md").read_text(encoding="utf-8")
    assert f"examples/{name}.py" in page
    assert f"](assets/examples/{name}.jpg)" in page
    assert (docs / "assets" / "examples" / f"{name}.jpg").stat().st_size < 400_000


@pytest.mark.parametrize("name", sorted(CHECKED))
def test_help_shows_how_to_run_it_on_data_of_ones_own(name, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [f"{name}.py", "--help"])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    assert end.value.code == 0
    assert f"python examples/{name}.py" in capsys.readouterr().out


def test_map_a_drive_maps_all_four_parked_cars(tmp_path):
    shown = run("map_a_drive", "--out", tmp_path / "run")
    assert figure(shown, "recall") == 1.0
    assert figure(shown, "voxel_iou_mean") > 0.9
    assert figure(shown, "centre_error_median_m") < 0.1
    scene = Map.load(tmp_path / "run")
    assert [f"car {number} at" in shown for number in scene] == [True] * 4
    assert len(Trajectory.load(tmp_path / "run" / "trajectory.tum")) == 12


def test_live_slam_has_meshes_while_it_runs_and_goes_on_where_it_was_saved():
    shown = run("live_slam")
    lines = [line for line in shown.splitlines() if "camera at" in line]
    assert len(lines) == 14
    assert all("unknown" not in line for line in lines)
    assert "meshes of cars [1, 2, 3, 4]" in lines[6]  # before the state is saved
    assert "meshes of cars [1, 2, 3, 4]" in lines[-1]
    assert figure(shown, "ate_rmse_m") < 0.15
    assert figure(shown, "recall") == 1.0
    assert figure(shown, "voxel_iou_mean") > 0.8


def test_localize_in_a_map_is_nearer_to_the_truth_than_the_imu_alone():
    shown = run("localize_in_a_map")
    by_map, by_imu = figure(shown, "by the map:"), figure(shown, "by the IMU alone:")
    assert by_map < 0.05
    assert by_map < by_imu


def test_mesh_from_masks_is_the_true_mesh():
    shown = run("mesh_from_masks")
    assert "vertices (642, 3)" in shown
    assert figure(shown, "mask IoU") > 0.98
    assert figure(shown, "voxel IoU with the true mesh") > 0.97


def test_own_category_is_built_and_used():
    shown = run("own_category")
    assert "642 vertices" in shown
    assert figure(shown, "voxel IoU") > 0.95


def test_mask_gradient_leads_the_optimizer_to_the_mask():
    shown = run("mask_gradient")
    assert figure(shown, "IoU") < 0.85
    assert figure(shown, "then") > 0.99
    metres, degrees = re.search(r"([\d.]+) m and ([\d.]+) degrees from the truth", shown).groups()
    assert float(metres) < 0.02
    assert float(degrees) < 0.5


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """A recording with a map of it, for the programs that take a user's own."""
    from meshslam import map_drive
    from meshslam.categories import load_category
    from meshslam.perception import write_detections
    from meshslam.sequences import camera_yaml
    from meshslam.simulation import StreetConfig, make_street, write_recording

    folder = tmp_path_factory.mktemp("own")
    size = {"width_px": 480, "height_px": 150, "focal_px": 285.0}
    street = StreetConfig(frames=10, cars_each_side=1, moving_cars=0, mode="contrast", **size)
    write_recording(make_street(load_category("car"), 2, street), folder / "drive")
    made = map_drive(folder / "drive")
    made.map.save(folder / "run")
    made.trajectory.save(folder / "run" / "trajectory.tum")
    (folder / "run" / "detections.json").write_bytes(write_detections(made.detections))
    (folder / "run" / "camera.yaml").write_text(camera_yaml(street_camera(folder / "drive"), None, None, 1.65))
    return folder


def street_camera(drive):
    from meshslam import open_sequence

    return open_sequence(drive).camera


def test_programs_take_a_drive_of_ones_own(drives):
    assert figure(run("map_a_drive", drives / "drive"), "recall") == 1.0
    assert "cars in the map: [1, 2]" in run("live_slam", drives / "drive", "--segmenter", "colour")
    assert figure(run("localize_in_a_map", drives / "drive", "--map", drives / "run"), "by the map:") < 0.05


def test_mask_gradient_takes_a_run_of_ones_own(drives):
    shown = run("mask_gradient", drives / "run")
    assert shown.count("object ") == 2
    assert figure(shown, "then") > 0.95


def test_mesh_from_masks_takes_a_folder_of_ones_own(tmp_path):
    import cv2
    import numpy as np

    from meshslam.categories import load_category
    from meshslam.geometry import Camera, Pose, render
    from meshslam.sequences import camera_yaml

    camera, car = Camera(320, 240, 300.0, 300.0, 159.5, 119.5), load_category("truck")
    ahead = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    poses = [
        Pose(Pose.from_yaw(turn, np.zeros(3)).rotation @ ahead, -9 * np.array([np.cos(turn), np.sin(turn), 0]))
        for turn in (0.3, 1.4, 2.6, 3.5)
    ]
    (tmp_path / "masks").mkdir()
    for k, pose in enumerate(poses):
        mask = render(camera, [(pose.inverse(), car.vertices, car.faces)]).mask
        cv2.imwrite(str(tmp_path / "masks" / f"{k}.png"), 255 * mask)
    (tmp_path / "camera.yaml").write_text(camera_yaml(camera, None, None, None))
    Trajectory(np.arange(4.0), tuple(poses)).save(tmp_path / "poses.tum")
    assert figure(run("mesh_from_masks", tmp_path, "--category", "truck"), "mask IoU") > 0.95
