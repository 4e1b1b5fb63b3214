"""KITTI odometry: folder `NN` with image_0 or image_2, calib.txt, times.txt; poses in ../poses/NN.txt."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from meshslam.errors import SequenceError
from meshslam.geometry import Floats, Pose
from meshslam.sequences.conventions import WORLD_FROM_FIRST_CAMERA
from meshslam.sequences.image_source import ImageFiles
from meshslam.sequences.images import frame_numbers, image_bits, list_images, load_image, note_turn
from meshslam.sequences.kitti import CAMERA_NUMBERS, HEIGHT_ABOVE_GROUND_M, read_calibration, split_projection
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.report import IncompleteError, Report, fail
from meshslam.sequences.sequence import Sequence
from meshslam.sequences.text import read_table, read_times, rigid


@dataclass(frozen=True)
class KittiOdometry:
    """Poses are KITTI's, of camera 0, moved to the chosen camera; without a poses file there are none."""

    name: str = "kitti-odometry"
    looks_for: str = "a folder that holds calib.txt and image_0 or image_2, times.txt beside them"
    accepts: frozenset[str] = frozenset()

    def recognizes(self, path: Path) -> bool:
        """By its image folders, or by its name and one of its files."""
        parts = [(path / f"image_{n}").is_dir() for n in CAMERA_NUMBERS]
        files = (path / "calib.txt").is_file() or (path / "times.txt").is_file()
        return any(parts) or (
            re.fullmatch(r"\d\d", path.name) is not None and files and not (path / "camera.yaml").exists()
        )

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """Everything in the camera's folder; see Loader."""
        return list_images(path / f"image_{_camera_number(path, options.camera_number)}")

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read calibration, times and poses; see Loader."""
        number = _camera_number(path, options.camera_number)
        images = report.attempt(lambda: self.image_files(path, options))
        calibration = report.attempt(lambda: read_calibration(path / "calib.txt", {f"P{number}": 12}, report))
        all_times_s = report.attempt(lambda: read_times(path / "times.txt", report))
        if images is None or calibration is None or all_times_s is None:
            raise IncompleteError(f"{path}: nothing to load")
        frame_ids = frame_numbers(images)
        note_turn(images, report)
        size = _image_size(images[0])
        camera, camera_from_camera0 = split_projection(
            path / "calib.txt", f"P{number}", calibration[f"P{number}"], size
        )
        if frame_ids[-1] >= len(all_times_s):
            what = f"{len(all_times_s)} times, but {images[-1].name} needs line {frame_ids[-1] + 1}"
            raise fail(path / "times.txt", "", what)
        poses = report.attempt(
            lambda: _read_poses(poses_file(path) if options.has_own_poses else None, frame_ids, report)
        )
        return Sequence(
            name=path.name,
            layout=self.name,
            root=path,
            camera=camera,
            frame_ids=frame_ids,
            times_s=all_times_s[list(frame_ids)],
            images=ImageFiles(tuple(images), image_bits(images, report)),
            world_from_camera=None if poses is None else tuple(p @ camera_from_camera0.inverse() for p in poses),
            is_levelled=False,
            detections_path=options.detections_path,
            height_above_ground_m=HEIGHT_ABOVE_GROUND_M,
        )


def poses_file(path: Path) -> Path | None:
    """Find NN.txt in `poses` beside the folder, or beside the `sequences` folder that it is in."""
    candidates = [path.parent / "poses" / f"{path.name}.txt"]
    if path.parent.name == "sequences":
        candidates.append(path.parent.parent / "poses" / f"{path.name}.txt")
    return next((file for file in candidates if file.is_file()), None)


def _camera_number(path: Path, wanted: int | None) -> int:
    if wanted is not None and wanted not in CAMERA_NUMBERS:
        raise SequenceError(f"{path}: KITTI odometry has the cameras {CAMERA_NUMBERS}, not {wanted}")
    if wanted is not None:
        return wanted
    return next((n for n in (0, 2, 1, 3) if (path / f"image_{n}").is_dir()), 0)


def _image_size(path: Path) -> tuple[int, int]:
    """calib.txt does not tell the images' size: the first image does."""
    height, width = load_image(path).shape[:2]
    return width, height


def _read_poses(path: Path | None, frame_ids: tuple[int, ...], report: Report) -> tuple[Pose, ...] | None:
    """world_from_camera0 of the frames; None without a file."""
    if path is None:
        return None
    table = read_table(path, 12, report, by_line=True)
    if frame_ids[-1] >= len(table.rows):
        raise fail(path, "", f"{len(table.rows)} poses, but frame {frame_ids[-1]} needs line {frame_ids[-1] + 1}")
    poses = [report.attempt(partial(_pose, path, table.lines[i], table.rows[i], report)) for i in frame_ids]
    if any(p is None for p in poses):
        raise IncompleteError(f"{path}: some poses are no rigid transforms")
    return tuple(p for p in poses if p is not None)


def _pose(path: Path, line: int, row: Floats, report: Report) -> Pose:
    return WORLD_FROM_FIRST_CAMERA @ rigid(path, f"line {line}", row.reshape(3, 4), report)
