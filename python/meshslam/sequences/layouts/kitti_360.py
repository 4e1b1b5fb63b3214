"""KITTI-360: data_2d_raw/DRIVE with image_00/data_rect; calibration and data_poses beside data_2d_raw."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.sequences import oxts
from meshslam.sequences.cameras.read import read_camera
from meshslam.sequences.image_source import ImageFiles
from meshslam.sequences.images import frame_numbers, image_bits, list_images, note_turn
from meshslam.sequences.kitti import read_calibration
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.pose_matching import all_or_some, poses_at
from meshslam.sequences.report import IncompleteError, Report, fail
from meshslam.sequences.sequence import Sequence
from meshslam.sequences.text import read_table, rigid

HEIGHT_ABOVE_GROUND_M = 1.55  # Liao et al., KITTI-360, TPAMI 2022, Fig. 2
CAMERA_NUMBERS = (0, 1)  # the rectified perspective ones


@dataclass(frozen=True)
class Kitti360:
    """Poses are those of data_poses/DRIVE/poses.txt, which leaves frames out; those between are interpolated."""

    name: str = "kitti-360"
    looks_for: str = "a folder data_2d_raw/DRIVE that holds image_00/data_rect"
    accepts: frozenset[str] = frozenset()

    def recognizes(self, path: Path) -> bool:
        """By its folders of rectified images."""
        return any((path / f"image_{n:02d}" / "data_rect").is_dir() for n in CAMERA_NUMBERS)

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """Everything in data_rect; see Loader."""
        return list_images(path / f"image_{_number(path, options):02d}" / "data_rect")

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read calibration, stamps and poses; see Loader."""
        number, home = _number(path, options), path.parent.parent
        files = report.attempt(lambda: self.image_files(path, options))
        perspective = home / "calibration" / "perspective.txt"
        found = report.attempt(lambda: read_camera(perspective, number, report=report))
        stamps = report.attempt(lambda: oxts.read_timestamps(path / f"image_{number:02d}" / "timestamps.txt", report))
        if files is None or found is None or stamps is None:
            raise IncompleteError(f"{path}: nothing to load")
        frame_ids = frame_numbers(files)
        if frame_ids[-1] >= len(stamps):
            what = f"{len(stamps)} lines, but {files[-1].name} needs line {frame_ids[-1] + 1}"
            raise fail(path / f"image_{number:02d}" / "timestamps.txt", "", what)
        every_s = oxts.seconds_from(stamps, int(stamps[0]))
        times_s = every_s[list(frame_ids)]
        given = home / "data_poses" / path.name / "poses.txt"
        poses = {}
        if options.has_own_poses and given.exists():
            pose_from_camera = _pose_from_camera(home / "calibration", number, report)
            poses = _poses(given, every_s, times_s, pose_from_camera, report)
        note_turn(files, report)
        every, some = all_or_some(poses, len(files))
        return Sequence(
            name=path.name,
            layout=self.name,
            root=path,
            camera=found.camera,
            frame_ids=frame_ids,
            times_s=times_s,
            images=ImageFiles(tuple(files), image_bits(files, report)),
            world_from_camera=every,
            detections_path=options.detections_path,
            height_above_ground_m=HEIGHT_ABOVE_GROUND_M,
            partial_poses=some,
        )


def _number(path: Path, options: LoadOptions) -> int:
    number = options.camera_number or 0
    if number not in CAMERA_NUMBERS:
        raise SequenceError(
            f"{path}: KITTI-360's perspective cameras are 0 and 1; its fisheye cameras {number} are not read"
        )
    return number


def _pose_from_camera(folder: Path, number: int, report: Report) -> Pose:
    """Of the rectified camera: calib_cam_to_pose.txt is of the raw one."""
    key = f"image_{number:02d}"
    mounted, turned = folder / "calib_cam_to_pose.txt", folder / "perspective.txt"
    raw = rigid(mounted, key, read_calibration(mounted, {key: 12}, report)[key].reshape(3, 4), report)
    name = f"R_rect_{number:02d}"
    rotation = read_calibration(turned, {name: 9}, report)[name].reshape(3, 3)
    rectified_from_raw = rigid(turned, name, np.column_stack([rotation, np.zeros(3)]), report)
    return raw @ rectified_from_raw.inverse()


def _poses(
    path: Path, every_s: np.ndarray, times_s: np.ndarray, pose_from_camera: Pose, report: Report
) -> dict[int, Pose]:
    """By frame: each line is a frame's number and world_from_pose, three rows of four."""
    table = read_table(path, 13, report)
    inside = [k for k, row in enumerate(table.rows) if 0 <= row[0] < len(every_s) and row[0] == int(row[0])]
    if not inside:
        raise fail(path, "", f"holds no pose of the {len(every_s)} frames")
    read = [rigid(path, f"line {table.lines[k]}", table.rows[k, 1:].reshape(3, 4), report) for k in inside]
    order = np.argsort(table.rows[inside, 0], kind="stable")
    poses = [read[k] @ pose_from_camera for k in order]
    pose_times_s = every_s[table.rows[inside, 0].astype(int)[order]]
    return poses_at(times_s, pose_times_s, poses, path, report)
