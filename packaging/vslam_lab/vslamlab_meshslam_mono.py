"""Entry script of meshslam as a baseline of VSLAM-LAB (mode mono): docs/vslam_lab.md says how it is put there.

It lays the experiment's frames out as a sequence folder, runs `meshslam slam` on it, and writes the trajectory.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import yaml

HEADER = ("ts (ns)", "tx (m)", "ty (m)", "tz (m)", "qx", "qy", "qz", "qw")
CAMERA = "rgb_0"
LENSES = {"radtan4": "radtan", "radtan5": "radtan", "equid4": "equidistant"}


def read_settings(path: Path) -> dict[str, Any]:
    """The settings of the baseline."""
    return yaml.safe_load(path.read_text()) if path.is_file() else {}


def read_frames(rgb_csv: Path, sequence_path: Path) -> list[tuple[int, Path]]:
    """Nanoseconds and image of each frame of the experiment."""
    with rgb_csv.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return [(int(float(row[f"ts_{CAMERA} (ns)"])), sequence_path / row[f"path_{CAMERA}"]) for row in rows]


def camera_yaml(calibration_yaml: Path, image: Path) -> dict[str, Any]:
    """Meshslam's camera.yaml, from VSLAM-LAB's calibration.yaml."""
    cameras = yaml.safe_load(calibration_yaml.read_text())["cameras"]
    lens = next(camera for camera in cameras if camera["cam_name"] == CAMERA)
    height, width = cv2.imread(str(image)).shape[:2]
    found = {
        "model": "pinhole",
        "resolution": [width, height],
        "intrinsics": [float(value) for value in [*lens["focal_length"], *lens["principal_point"]]],
    }
    kind = lens.get("distortion_type", "radtan4")
    coefficients = [float(value) for value in lens.get("distortion_coefficients", [])]
    if any(coefficients):
        found |= {"distortion_model": LENSES[kind], "distortion_coeffs": coefficients}
    return found


def lay_out(frames: list[tuple[int, Path]], camera: dict[str, Any], folder: Path) -> Path:
    """A sequence folder of these frames; images are linked."""
    (folder / "images").mkdir(parents=True, exist_ok=True)
    for number, (_, image) in enumerate(frames):
        link = folder / "images" / f"{number:06d}{image.suffix}"
        link.unlink(missing_ok=True)
        link.symlink_to(image.resolve())
    (folder / "times.txt").write_text("".join(f"{ns / 1e9:.9f}\n" for ns, _ in frames))
    (folder / "camera.yaml").write_text(yaml.safe_dump(camera))
    return folder


def run(sequence: Path, out: Path, settings: dict[str, Any]) -> None:
    """`meshslam slam`; CalledProcessError if it ends with anything but a path."""
    command = [sys.executable, "-m", "meshslam", "slam", sequence, "--out", out, "--overwrite", "--poses", "none"]
    for flag in ("segmenter", "category", "config"):
        if settings.get(flag):
            command += [f"--{flag}", str(settings[flag])]
    code = subprocess.run(command, check=False).returncode
    if code not in (0, 3):  # 3: there is a path, but no car was mapped
        raise subprocess.CalledProcessError(code, command)


def write_trajectory(run_folder: Path, frames: list[tuple[int, Path]], target: Path) -> None:
    """VSLAM-LAB's CSV of a run's trajectory, with the times as they were given."""
    poses = [line.split() for line in (run_folder / "trajectory.tum").read_text().splitlines()]
    times_ns = {f"{ns / 1e9:.9f}": ns for ns, _ in frames}
    with target.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        writer.writerows([times_ns[pose[0]], *pose[1:]] for pose in poses)


def main() -> None:
    """Take VSLAM-LAB's arguments; others are left alone."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("sequence_path", "calibration_yaml", "rgb_csv", "exp_folder", "settings_yaml"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    parser.add_argument("--exp_it", required=True)
    given, _ = parser.parse_known_args()
    number = given.exp_it.zfill(5)
    work = given.exp_folder / f"meshslam_{number}"
    frames = read_frames(given.rgb_csv, given.sequence_path)
    sequence = lay_out(frames, camera_yaml(given.calibration_yaml, frames[0][1]), work / "sequence")
    run(sequence, work / "run", read_settings(given.settings_yaml))
    write_trajectory(work / "run", frames, given.exp_folder / f"{number}_KeyFrameTrajectory.csv")


if __name__ == "__main__":
    main()
