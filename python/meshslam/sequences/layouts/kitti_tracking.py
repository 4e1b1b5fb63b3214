"""KITTI tracking: training/image_02/NNNN with ../../calib/NNNN.txt and ../../oxts/NNNN.txt."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.errors import SequenceError
from meshslam.geometry import Camera, Floats, Pose
from meshslam.sequences import oxts
from meshslam.sequences.image_source import ImageFiles
from meshslam.sequences.images import frame_numbers, image_bits, list_images, load_image, note_turn
from meshslam.sequences.kitti import CAMERA_NUMBERS, HEIGHT_ABOVE_GROUND_M, split_projection
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.report import IncompleteError, Report, fail
from meshslam.sequences.sequence import ImuSamples, Sequence
from meshslam.sequences.text import read_table, read_text, rigid

RATE_HZ = 10.0  # of frames and OXTS: the benchmark has no stamps


@dataclass(frozen=True)
class KittiTracking:
    """Poses from OXTS in the local east-north-up frame of its first sample; the sequence is the images' folder."""

    name: str = "kitti-tracking"
    looks_for: str = "a folder image_02/NNNN beside calib/NNNN.txt"
    accepts: frozenset[str] = frozenset()

    def recognizes(self, path: Path) -> bool:
        """By the calibration beside its parent, or by the parts of the whole benchmark's folder."""
        return (_calibration(path)).is_file() or ((path / "calib").is_dir() and any(path.glob("image_0[0-3]/[0-9]*")))

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """Everything in the sequence's folder; see Loader."""
        return list_images(_images_folder(path, options))

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read calibration and OXTS; see Loader."""
        folder = _images_folder(path, options)
        number = int(folder.parent.name[-1])
        files = report.attempt(lambda: list_images(folder))
        if files is None:
            raise IncompleteError(f"{path}: nothing to load")
        height, width = load_image(files[0]).shape[:2]
        found = report.attempt(lambda: _rig(_calibration(folder), number, (width, height), report))
        if found is None:
            raise IncompleteError(f"{path}: no camera")
        camera, imu_from_camera = found
        frame_ids = frame_numbers(files)
        samples = folder.parent.parent / "oxts" / f"{folder.name}.txt"
        rows = report.attempt(lambda: _oxts(samples, frame_ids, report)) if samples.exists() else None
        report.note(folder, "", f"KITTI tracking has no times: {RATE_HZ:.0f} frames a second")
        note_turn(files, report)
        poses = None if rows is None or not options.has_own_poses else oxts.world_from_imu(rows, rows[0])
        return Sequence(
            name=folder.name,
            layout=self.name,
            root=path,
            camera=camera,
            frame_ids=frame_ids,
            times_s=np.array(frame_ids) / RATE_HZ,
            images=ImageFiles(tuple(files), image_bits(files, report)),
            world_from_camera=None if poses is None else tuple(poses[i] @ imu_from_camera for i in frame_ids),
            detections_path=options.detections_path,
            imu=None if rows is None or not options.has_own_imu else _imu(rows),
            imu_from_camera=imu_from_camera,
            height_above_ground_m=HEIGHT_ABOVE_GROUND_M,
        )


def _calibration(folder: Path) -> Path:
    return folder.parent.parent / "calib" / f"{folder.name}.txt"


def _images_folder(path: Path, options: LoadOptions) -> Path:
    """The folder itself, or the only sequence of the benchmark's folder."""
    wanted = options.camera_number
    if wanted is not None and wanted not in CAMERA_NUMBERS:
        raise SequenceError(f"{path}: KITTI tracking has the cameras {CAMERA_NUMBERS}, not {wanted}")
    if _calibration(path).is_file():
        return path if wanted is None else path.parent.parent / f"image_{wanted:02d}" / path.name
    parts = sorted(path.glob(f"image_{2 if wanted is None else wanted:02d}/[0-9]*"))
    if len(parts) != 1:
        names = ", ".join(str(p.relative_to(path)) for p in parts[:4]) or "none"
        raise SequenceError(f"{path}: holds {len(parts)} sequences: name one of them: {names}")
    return parts[0]


def _rig(path: Path, number: int, size: tuple[int, int], report: Report) -> tuple[Camera, Pose]:
    """The rectified camera and imu_from_camera; keys stand with a colon or without one."""
    keys = (f"P{number}", "R_rect", "Tr_velo_cam", "Tr_imu_velo")
    values = {key: _numbers(path, key) for key in keys}
    camera, camera_from_rectified = split_projection(path, keys[0], values[keys[0]], size)
    rectified = np.column_stack([values["R_rect"].reshape(3, 3), np.zeros(3)])
    steps = [rigid(path, "R_rect", rectified, report)]
    steps += [rigid(path, key, values[key].reshape(3, 4), report) for key in keys[2:]]
    return camera, (camera_from_rectified @ steps[0] @ steps[1] @ steps[2]).inverse()


def _numbers(path: Path, key: str) -> Floats:
    size = 9 if key == "R_rect" else 12
    other = {"R_rect": "R0_rect", "Tr_velo_cam": "Tr_velo_to_cam", "Tr_imu_velo": "Tr_imu_to_velo"}.get(key, key)
    match = re.search(rf"^(?:{key}|{other}):?[ \t]+(.*)$", read_text(path), re.MULTILINE)
    words = match[1].split() if match else []
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        values = np.zeros(0)
    if len(values) != size or not np.isfinite(values).all():
        raise fail(path, key, f"expected {size} numbers, found {len(words)}")
    return values


def _oxts(path: Path, frame_ids: tuple[int, ...], report: Report) -> Floats:
    table = read_table(path, oxts.FIELDS, report, by_line=True)
    if frame_ids[-1] >= len(table.rows):
        raise fail(path, "", f"{len(table.rows)} samples, but frame {frame_ids[-1]} needs line {frame_ids[-1] + 1}")
    return table.rows


def _imu(rows: Floats) -> ImuSamples:
    return ImuSamples(np.arange(len(rows)) / RATE_HZ, rows[:, oxts.ANGULAR_RATE], rows[:, oxts.SPECIFIC_FORCE])
