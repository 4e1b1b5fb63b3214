"""The sequence folder: camera.yaml, times.txt, images/ or detections.json; poses, IMU, initial state where known."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import GeometryError, SequenceError
from meshslam.files import real_path
from meshslam.geometry import Camera, Floats, Pose
from meshslam.sequences.calibration import distortion_of
from meshslam.sequences.distortion import Distortion
from meshslam.sequences.image_source import ImageFiles
from meshslam.sequences.images import are_numbered, frame_numbers, image_bits, list_images, note_turn
from meshslam.sequences.imu_files import read_imu
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.pose_matching import all_or_some, poses_at
from meshslam.sequences.report import IncompleteError, Report, fail
from meshslam.sequences.sequence import ImuSamples, InitialState, Sequence
from meshslam.sequences.text import numbers_of, pose_of, read_times, read_yaml
from meshslam.sequences.tum import read_tum

CAMERA_KEYS = (
    "model",
    "resolution",
    "intrinsics",
    "skew",
    "distortion_model",
    "distortion_coeffs",
    "imu_from_camera",
    "height_above_ground_m",
)


@dataclass(frozen=True, eq=False)
class CameraFile:
    """What camera.yaml, or a calibration file, says."""

    camera: Camera  # undistorted; the file's own where there is no distortion
    distortion: Distortion | None = None
    imu_from_camera: Pose | None = None
    height_above_ground_m: float | None = None


@dataclass(frozen=True)
class SequenceFolder:
    """Frame numbers are the images' names where every name is a number, else counted from 0."""

    name: str = "folder"
    looks_for: str = "a folder that holds camera.yaml and times.txt"
    accepts: frozenset[str] = frozenset({"conventions"})

    def recognizes(self, path: Path) -> bool:
        """By its files."""
        parts = ("times.txt", "images", "detections.json")
        return (path / "camera.yaml").is_file() or sum((path / part).exists() for part in parts) > 1

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """Everything in images/; see Loader."""
        return list_images(path / "images") if (path / "images").exists() else []

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read all but images and detections; see Loader."""
        if options.camera_number is not None:
            raise SequenceError(f"{path}: a sequence folder has one camera: leave out the camera number")
        camera = report.attempt(lambda: read_camera_file(path / "camera.yaml", report))
        times_s = report.attempt(lambda: read_times(path / "times.txt", report))
        images = report.attempt(lambda: self.image_files(path, options)) or []
        poses = report.attempt(lambda: _known_poses(path / "poses.tum", times_s, options, report)) or {}
        imu = report.attempt(lambda: _imu(path / "imu.csv", report)) if options.has_own_imu else None
        start = report.attempt(lambda: _initial_state(path / "initial_state.yaml", report))
        if camera is None or times_s is None:
            raise IncompleteError(f"{path}: nothing to load")
        if imu is not None and camera.imu_from_camera is None:
            what = "key is missing: to use imu.csv, localize and slam need it, a 4x4 matrix, or --imu-from-camera FILE"
            report.note(path / "camera.yaml", "imu_from_camera", what)
        if imu is not None and (imu.times_s[0] > times_s[-1] or imu.times_s[-1] < times_s[0]):
            report.add(path / "imu.csv", "", "no sample lies between the first and the last frame: another clock?")
        frame_ids = _frame_ids(path, times_s, images, report)
        count = len(frame_ids)
        every, some = all_or_some(poses, count)
        note_turn(images, report)
        return Sequence(
            name=real_path(path).name,
            layout=self.name,
            root=path,
            camera=camera.camera,
            frame_ids=frame_ids,
            times_s=times_s[:count],
            images=ImageFiles(tuple(images[:count]), image_bits(images, report)) if images else None,
            world_from_camera=every,
            is_levelled=options.poses_convention != "first-camera-world",
            detections_path=_detections(path, options, images),
            imu=imu,
            imu_from_camera=camera.imu_from_camera,
            initial_state=start,
            height_above_ground_m=camera.height_above_ground_m,
            distortion=camera.distortion,
            partial_poses=some,
        )


def read_camera_file(path: Path, report: Report | None = None) -> CameraFile:
    """Read a camera.yaml. SequenceError without a `report` that gathers what is wrong."""
    report = Report() if report is None else report
    content = read_yaml(path)
    for key in content:
        if key not in CAMERA_KEYS:
            near = get_close_matches(key, CAMERA_KEYS, 1)
            meant = f"did you mean {near[0]}? " if near else ""
            report.add(path, key[:60], f"unknown key; {meant}known are {', '.join(CAMERA_KEYS)}")
    if content.get("model", "pinhole") != "pinhole":
        report.add(path, "model", f"expected pinhole, found {content['model']!r}")
    raw = _camera(path, content, report)
    extrinsics, height = content.get("imu_from_camera"), content.get("height_above_ground_m")
    distortion = report.attempt(lambda: _distortion(path, content, raw, report))
    return CameraFile(
        camera=raw if distortion is None else distortion.camera,
        distortion=distortion,
        imu_from_camera=None
        if extrinsics is None
        else report.attempt(lambda: pose_of(path, "imu_from_camera", extrinsics, report)),
        height_above_ground_m=None
        if height is None
        else report.attempt(lambda: _positive(path, "height_above_ground_m", height)),
    )


def _camera(path: Path, content: dict[str, Any], report: Report) -> Camera:
    size = report.attempt(lambda: _required(path, content, "resolution", 2))
    intrinsics = report.attempt(lambda: _required(path, content, "intrinsics", 4))
    skew = report.attempt(lambda: numbers_of(path, "skew", content.get("skew", 0.0)).reshape(-1))
    if size is None or intrinsics is None or skew is None:
        raise IncompleteError(f"{path}: no camera")
    if (size != np.round(size)).any() or (size < 1).any():
        raise fail(path, "resolution", f"expected [width, height] in whole pixels, found {size.tolist()}")
    if len(skew) != 1:
        raise fail(path, "skew", f"expected one number, found {skew.tolist()}")
    fx, fy, cx, cy = (float(value) for value in intrinsics)
    try:
        return Camera(int(size[0]), int(size[1]), fx, fy, cx, cy, float(skew[0]))
    except GeometryError as error:
        raise fail(path, "intrinsics", str(error)) from None


def _required(path: Path, content: dict[str, Any], key: str, size: int) -> Floats:
    if content.get(key) is None:
        raise fail(path, key, f"key is missing, expected {size} numbers")
    values = numbers_of(path, key, content[key]).reshape(-1)
    if len(values) != size:
        raise fail(path, key, f"expected {size} numbers, found {len(values)}")
    return values


def _positive(path: Path, key: str, value: object) -> float:
    values = numbers_of(path, key, value).reshape(-1)
    if len(values) != 1 or values[0] <= 0:
        raise fail(path, key, f"expected a positive number, found {value!r}")
    return float(values[0])


def _distortion(path: Path, content: dict[str, Any], raw: Camera, report: Report) -> Distortion | None:
    model = content.get("distortion_model") or "none"
    coefficients = numbers_of(path, "distortion_coeffs", content.get("distortion_coeffs") or []).reshape(-1)
    return distortion_of(path, ("distortion_model", "distortion_coeffs"), model, coefficients, raw, report)


def _detections(path: Path, options: LoadOptions, images: list[Path]) -> Path | None:
    own = path / "detections.json"
    chosen = options.detections_path or (own if own.is_file() else None)
    if chosen is None and not images:
        raise fail(path, "", "neither images/ nor detections.json is there: one of them is needed")
    return chosen


def _frame_ids(path: Path, times_s: Floats, images: list[Path], report: Report) -> tuple[int, ...]:
    if not images:
        return tuple(range(len(times_s)))
    if len(images) != len(times_s):
        report.add(path / "times.txt", "", f"{len(times_s)} times, but images/ holds {len(images)} images")
    numbers = frame_numbers(images) if are_numbered(images) else tuple(range(len(images)))
    return numbers[: len(times_s)]


def _known_poses(path: Path, times_s: Floats | None, options: LoadOptions, report: Report) -> dict[int, Pose]:
    if not path.exists() or not options.has_own_poses:
        return {}
    pose_times_s, read = read_tum(path, report)
    return {} if times_s is None else poses_at(times_s, pose_times_s, options.world_from_camera(read), path, report)


def _imu(path: Path, report: Report) -> ImuSamples | None:
    return read_imu(path, report) if path.exists() else None


def _initial_state(path: Path, report: Report) -> InitialState | None:
    if not path.exists():
        return None
    content = read_yaml(path)
    time = report.attempt(lambda: _required(path, content, "timestamp", 1))
    velocity = report.attempt(lambda: _required(path, content, "velocity_in_world", 3))
    if content.get("world_from_camera") is None:
        raise fail(path, "world_from_camera", "key is missing, expected a 4x4 matrix")
    pose = report.attempt(lambda: pose_of(path, "world_from_camera", content["world_from_camera"], report))
    if time is None or velocity is None or pose is None:
        raise IncompleteError(f"{path}: no initial state")
    return InitialState(float(time[0]), pose, velocity)
