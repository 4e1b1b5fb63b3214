"""IMU samples and extrinsics from files of their own, for any sequence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from meshslam.geometry import Pose
from meshslam.sequences.report import Report, fail
from meshslam.sequences.sequence import ImuSamples, Sequence
from meshslam.sequences.text import check_increasing, numbers_of, pose_of, read_csv, read_text, read_yaml

IMU_COLUMNS = ("timestamp", "wx", "wy", "wz", "ax", "ay", "az")


def read_imu(path: Path, report: Report) -> ImuSamples:
    """Read a CSV with the header timestamp,wx,wy,wz,ax,ay,az: seconds, rad/s, m/s² in the imu frame."""
    table = read_csv(path, IMU_COLUMNS, report)
    if not len(table.rows):
        raise fail(path, "", "holds no samples")
    check_increasing(path, table.rows[:, 0], table.lines, report)
    return ImuSamples(table.rows[:, 0], table.rows[:, 1:4], table.rows[:, 4:7])


def read_extrinsics(path: Path, camera_number: int | None = None) -> tuple[Pose, float]:
    """imu_from_camera, and by how many seconds the IMU's clock is ahead of the camera's.

    Taken from Kalibr's camchain-imucam YAML (`camN` with `T_cam_imu` and `timeshift_cam_imu`), a YAML or JSON mapping
    with the key `imu_from_camera` or `camera_from_imu`, or a bare 4x4 matrix, which is imu_from_camera unless the file
    is called camera_from_imu.
    """
    content = _parsed(path)
    if isinstance(content, list):
        matrix = pose_of(path, path.stem, content)
        return (matrix.inverse() if path.stem == "camera_from_imu" else matrix), 0.0
    cameras = sorted(key for key in content if key.startswith("cam") and key[3:].isdigit())
    if cameras:
        return _kalibr(path, content, cameras, camera_number)
    if content.get("imu_from_camera") is not None:
        return pose_of(path, "imu_from_camera", content["imu_from_camera"]), 0.0
    if content.get("camera_from_imu") is not None:
        return pose_of(path, "camera_from_imu", content["camera_from_imu"]).inverse(), 0.0
    raise fail(path, "", "expected the key imu_from_camera or camera_from_imu (4x4), or Kalibr's cam0 with T_cam_imu")


def with_imu(sequence: Sequence, imu_path: Path | None, extrinsics_path: Path | None) -> Sequence:
    """The sequence with an IMU, or extrinsics, from files; its samples on the camera's clock."""
    imu = sequence.imu if imu_path is None else read_imu(imu_path, Report())
    mounted, ahead_s = sequence.imu_from_camera, 0.0
    if extrinsics_path is not None:
        mounted, ahead_s = read_extrinsics(extrinsics_path)
    if imu is not None and ahead_s:
        imu = replace(imu, times_s=imu.times_s - ahead_s)
    return replace(sequence, imu=imu, imu_from_camera=mounted)


def _parsed(path: Path) -> dict[str, Any] | list[Any]:
    text = read_text(path)
    if not text.lstrip().startswith("["):
        return read_yaml(path)
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise fail(path, "", f"cannot be read: {' '.join(str(error).split())}") from None
    return content if isinstance(content, list) else {}


def _kalibr(path: Path, content: dict[str, Any], cameras: list[str], number: int | None) -> tuple[Pose, float]:
    name = cameras[0] if number is None else f"cam{number}"
    entry = content.get(name)
    if not isinstance(entry, dict) or entry.get("T_cam_imu") is None:
        raise fail(path, name, "expected T_cam_imu, a 4x4 matrix, as Kalibr's camchain-imucam has it")
    camera_from_imu = pose_of(path, f"{name}: T_cam_imu", entry["T_cam_imu"])
    ahead = numbers_of(path, f"{name}: timeshift_cam_imu", entry.get("timeshift_cam_imu", 0.0)).reshape(-1)
    if len(ahead) != 1:
        raise fail(path, f"{name}: timeshift_cam_imu", f"expected one number, found {ahead.tolist()}")
    return camera_from_imu.inverse(), float(ahead[0])
