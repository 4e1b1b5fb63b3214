"""KITTI raw, rectified and synchronized: `<date>_drive_<number>_sync`, its calibration files one folder up."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.errors import SequenceError
from meshslam.geometry import Camera, Floats, Ints, Pose
from meshslam.sequences import oxts
from meshslam.sequences.image_source import ImageFiles
from meshslam.sequences.images import frame_numbers, image_bits, list_images, note_turn
from meshslam.sequences.interpolation import interpolate_poses
from meshslam.sequences.kitti import CAMERA_NUMBERS, HEIGHT_ABOVE_GROUND_M, read_calibration, split_projection
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.report import IncompleteError, Report, fail
from meshslam.sequences.sequence import ImuSamples, Sequence
from meshslam.sequences.text import rigid


@dataclass(frozen=True)
class KittiRaw:
    """Poses from OXTS in the local east-north-up frame of its first position; time 0 is the camera's first frame."""

    name: str = "kitti-raw"
    looks_for: str = "a folder YYYY_MM_DD_drive_NNNN_sync, or one that holds oxts and image_02 or image_03"
    accepts: frozenset[str] = frozenset()

    def recognizes(self, path: Path) -> bool:
        """By the folder's name, or by its parts."""
        named = re.fullmatch(r"\d{4}_\d\d_\d\d_drive_\d{4}_sync", path.name) is not None
        return named or ((path / "oxts").is_dir() and any(path.glob("image_0[0-3]")))

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """Everything in the camera's data folder; see Loader."""
        return list_images(_images_folder(path, _camera_number(options)) / "data")

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read calibration, timestamps and OXTS; see Loader."""
        number = _camera_number(options)
        images_folder = _images_folder(path, number)
        calibration = report.attempt(lambda: read_rig(path.parent, number, report))
        images = report.attempt(lambda: self.image_files(path, options))
        stamps = report.attempt(lambda: _image_timestamps(images_folder / "timestamps.txt", report))
        recording = report.attempt(lambda: oxts.read_oxts(path / "oxts", report))
        if calibration is None or images is None or stamps is None or recording is None:
            raise IncompleteError(f"{path}: nothing to load")
        camera, imu_from_camera = calibration
        frame_ids = _timed_frames(images_folder, images, stamps)
        note_turn(images, report)
        zero_ns = int(stamps[0])
        times_s = oxts.seconds_from(stamps[list(frame_ids)], zero_ns)
        poses = (
            report.attempt(lambda: _camera_poses(path, recording, frame_ids, zero_ns, times_s, report))
            if options.has_own_poses
            else None
        )
        return Sequence(
            name=path.name,
            layout=self.name,
            root=path,
            camera=camera,
            frame_ids=frame_ids,
            times_s=times_s,
            images=ImageFiles(tuple(images), image_bits(images, report)),
            world_from_camera=None if poses is None else tuple(p @ imu_from_camera for p in poses),
            detections_path=options.detections_path,
            imu=report.attempt(lambda: _imu(path, recording, zero_ns, report)),
            imu_from_camera=imu_from_camera,
            height_above_ground_m=HEIGHT_ABOVE_GROUND_M,
        )


def read_rig(folder: Path, camera_number: int, report: Report) -> tuple[Camera, Pose]:
    """Read a date's three calibration files: the rectified camera, and imu_from_camera."""
    size_key, projection_key = f"S_rect_{camera_number:02d}", f"P_rect_{camera_number:02d}"
    cameras_file = folder / "calib_cam_to_cam.txt"
    keys = {size_key: 2, projection_key: 12, "R_rect_00": 9}
    cameras = report.attempt(lambda: read_calibration(cameras_file, keys, report))
    camera0_from_velo = report.attempt(lambda: _read_rigid(folder / "calib_velo_to_cam.txt", report))
    velo_from_imu = report.attempt(lambda: _read_rigid(folder / "calib_imu_to_velo.txt", report))
    if cameras is None or camera0_from_velo is None or velo_from_imu is None:
        raise IncompleteError(f"{folder}: calibration is incomplete")
    size = (int(cameras[size_key][0]), int(cameras[size_key][1]))
    camera, camera_from_rectified = split_projection(cameras_file, projection_key, cameras[projection_key], size)
    rectified_from_camera0 = _rigid_parts(cameras_file, "R_rect_00", cameras["R_rect_00"], np.zeros(3), report)
    camera_from_imu = camera_from_rectified @ rectified_from_camera0 @ camera0_from_velo @ velo_from_imu
    return camera, camera_from_imu.inverse()


def _read_rigid(path: Path, report: Report) -> Pose:
    values = read_calibration(path, {"R": 9, "T": 3}, report)
    return _rigid_parts(path, "R", values["R"], values["T"], report)


def _rigid_parts(path: Path, key: str, rotation: Floats, translation: Floats, report: Report) -> Pose:
    return rigid(path, key, np.column_stack([rotation.reshape(3, 3), translation]), report)


def _camera_number(options: LoadOptions) -> int:
    return 2 if options.camera_number is None else options.camera_number


def _images_folder(path: Path, number: int) -> Path:
    if number not in CAMERA_NUMBERS:
        raise SequenceError(f"{path}: KITTI raw has the cameras {CAMERA_NUMBERS}, not {number}")
    folder = path / f"image_{number:02d}"
    others = [p.name for p in sorted(path.glob("image_0[0-3]"))]
    if not folder.is_dir():
        hint = f"; there is {', '.join(others)}: choose that camera's number" if others else ""
        raise fail(folder, "", f"no such folder{hint}")
    return folder


def _image_timestamps(path: Path, report: Report) -> Ints:
    stamps = oxts.read_timestamps(path, report)
    for i in np.flatnonzero(np.diff(stamps) <= 0):
        report.add(path, f"line {i + 2}", "this time is not after the one of the line before; times must increase")
    return stamps


def _timed_frames(images_folder: Path, images: list[Path], stamps: Ints) -> tuple[int, ...]:
    frame_ids = frame_numbers(images)
    if frame_ids[-1] >= len(stamps):
        what = f"{len(stamps)} lines, but {images[-1].name} needs line {frame_ids[-1] + 1}"
        raise fail(images_folder / "timestamps.txt", "", what)
    return frame_ids


def _camera_poses(
    path: Path, recording: oxts.Oxts, frame_ids: tuple[int, ...], zero_ns: int, times_s: Floats, report: Report
) -> tuple[Pose, ...]:
    """Poses of the imu at the images' times: OXTS is recorded up to about 10 ms beside them."""
    missing = sorted(set(frame_ids) - set(recording.numbers))
    for number in missing:
        report.add(
            path / "oxts" / "data" / f"{number:010d}.txt", "", f"no such sample, but frame {number} needs its pose"
        )
    if missing:
        raise IncompleteError(f"{path}: fewer poses than frames")
    oxts_times_s = oxts.seconds_from(recording.times_ns, zero_ns)
    for i in np.flatnonzero(np.diff(oxts_times_s) <= 0):
        report.add(
            path / "oxts" / "timestamps.txt", f"line {i + 2}", "this time is not after the one of the line before"
        )
    poses = oxts.world_from_imu(recording.rows, recording.rows[0])
    try:
        return interpolate_poses(oxts_times_s, poses, times_s)
    except SequenceError as error:
        raise fail(path / "oxts" / "timestamps.txt", "", str(error)) from None


def _imu(path: Path, recording: oxts.Oxts, zero_ns: int, report: Report) -> ImuSamples:
    """100 Hz from the drive's `_extract` folder where it lies beside, else what the synchronized frames carry."""
    fast = path.with_name(path.name.removesuffix("_sync") + "_extract") / "oxts"
    if path.name.endswith("_sync") and fast.is_dir():
        recording = oxts.read_oxts(fast, report)
    return oxts.imu_samples(recording, zero_ns)
