"""Where IMU and body sit on the camera, from files of their own, for any sequence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.geometry import Camera, Pose
from meshslam.sequences.cameras.found import CameraFormat, FoundCamera
from meshslam.sequences.cameras.kalibr import kalibr_mounting
from meshslam.sequences.cameras.read import FORMATS
from meshslam.sequences.imu_files import read_imu
from meshslam.sequences.report import Report, fail
from meshslam.sequences.sequence import Sequence
from meshslam.sequences.text import parsed_yaml, pose_of, read_text, read_yaml


def read_extrinsics(
    path: Path, camera_number: int | None = None, camera: Camera | None = None, report: Report | None = None
) -> tuple[Pose, float]:
    """imu_from_camera, and by how many seconds the IMU's clock is ahead of the camera's.

    Taken from Kalibr's camchain-imucam YAML (`camN` with `T_cam_imu`, or the chain's `T_cn_cnm1` from one that has it,
    and `timeshift_cam_imu`), from the other calibrations with a mounting (docs/cameras.md), a YAML or JSON mapping
    with the key `imu_from_camera` or `camera_from_imu`, or a bare 4x4 matrix, which is imu_from_camera unless the file
    is called camera_from_imu. Of several cameras the one of that number is taken, else the one with the intrinsics of
    `camera`; SequenceError where neither tells.
    """
    content, report = _parsed(path), report or Report()
    if isinstance(content, list):
        matrix = pose_of(path, path.stem, content, report)
        return (matrix.inverse() if path.stem == "camera_from_imu" else matrix), 0.0
    cameras = sorted(key for key in content if key.startswith("cam") and key[3:].isdigit())
    if cameras:
        return _kalibr(path, content, _camera_of_rig(path, content, cameras, camera_number, camera, report), report)
    if content.get("imu_from_camera") is not None:
        return pose_of(path, "imu_from_camera", content["imu_from_camera"], report), 0.0
    if content.get("camera_from_imu") is not None:
        return pose_of(path, "camera_from_imu", content["camera_from_imu"], report).inverse(), 0.0
    for known in FORMATS:
        if known.cameras(content):
            return _mounted(path, content, known, camera_number, camera, report)
    raise fail(path, "", "expected the key imu_from_camera or camera_from_imu (4x4), or Kalibr's cam0 with T_cam_imu")


def _mounted(
    path: Path,
    content: Mapping[str, Any],
    known: CameraFormat,
    number: int | None,
    camera: Camera | None,
    report: Report,
) -> tuple[Pose, float]:
    """The mounting of one camera of another tool's calibration: that of the number, the only one, or the alike one."""
    names = known.cameras(content)
    found = {n: known.read(path, content, n, report) for n in names if number in (None, n)}
    if number is None and len(found) > 1:
        found = {n: entry for n, entry in found.items() if camera is not None and _is_alike(entry, camera)}
    if len(found) != 1:
        listed = ", ".join(f"{n} ({name})" for n, name in names.items())
        raise fail(path, "", f"holds the cameras {listed}: give --camera N")
    ((chosen, entry),) = found.items()
    if entry.imu_from_camera is None:
        raise fail(path, names[chosen], f"{known.name}: says nothing of how the IMU is mounted: give a file that does")
    return entry.imu_from_camera, entry.imu_ahead[1]


def _is_alike(entry: FoundCamera, camera: Camera) -> bool:
    """Whether a calibration's camera has this one's size, and its intrinsics within 2%."""
    own = [camera.fx, camera.fy, camera.cx, camera.cy]
    has_size = entry.size in (None, (camera.width, camera.height))
    return has_size and bool(np.allclose(entry.intrinsics[:4], own, rtol=0.02))


def read_camera_from_body(path: Path, report: Report | None = None) -> Pose:
    """camera_from_body from a YAML or JSON mapping with that key or body_from_camera, or a bare 4x4 matrix.

    A bare matrix is camera_from_body, unless the file is called body_from_camera.
    """
    content, report = _parsed(path), report or Report()
    if isinstance(content, list):
        matrix = pose_of(path, path.stem, content, report)
        return matrix.inverse() if path.stem == "body_from_camera" else matrix
    if content.get("camera_from_body") is not None:
        return pose_of(path, "camera_from_body", content["camera_from_body"], report)
    if content.get("body_from_camera") is not None:
        return pose_of(path, "body_from_camera", content["body_from_camera"], report).inverse()
    raise fail(path, "", "expected the key camera_from_body or body_from_camera (4x4), or a bare 4x4 matrix")


def with_imu(
    sequence: Sequence,
    imu_path: Path | None,
    extrinsics_path: Path | None,
    camera_number: int | None = None,
    time_offset_s: float = 0.0,
) -> Sequence:
    """The sequence with an IMU, or extrinsics, from files; its samples on the camera's clock.

    The IMU's clock is `time_offset_s` ahead, beyond what the extrinsics' file says.
    """
    report = Report()
    imu = sequence.imu if imu_path is None else read_imu(imu_path, report)
    mounted, ahead_s = sequence.imu_from_camera, time_offset_s
    if extrinsics_path is not None:
        mounted, told_s = read_extrinsics(extrinsics_path, camera_number, sequence.raw_camera, report)
        ahead_s += told_s
    if imu is not None and ahead_s:
        imu = replace(imu, times_s=imu.times_s - ahead_s)
    return replace(sequence, imu=imu, imu_from_camera=mounted, notes=(*sequence.notes, *report.notes))


def _camera_of_rig(
    path: Path, content: dict[str, Any], cameras: list[str], number: int | None, camera: Camera | None, report: Report
) -> str:
    """The key of a rig's camera: the number that was given, the only one, or the one with these intrinsics."""
    if number is not None:
        return f"cam{number}"
    if len(cameras) == 1:
        return cameras[0]
    alike = [] if camera is None else [name for name in cameras if _is_camera(content[name], camera)]
    if len(alike) != 1:
        found = f"{', '.join(alike)} have" if alike else "none has"
        raise fail(path, "", f"holds {', '.join(cameras)}, and {found} this recording's intrinsics: give --camera N")
    report.note(path, alike[0], f"has this recording's intrinsics: it is taken, of {', '.join(cameras)}")
    return alike[0]


def _is_camera(entry: object, camera: Camera) -> bool:
    """Whether a rig's entry has the camera's resolution, and its intrinsics within 2%."""
    if not isinstance(entry, dict):
        return False
    size, intrinsics = entry.get("resolution"), entry.get("intrinsics")
    if size is not None and size != [camera.width, camera.height]:
        return False
    own = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    try:
        given = np.asarray(intrinsics, float)
    except (TypeError, ValueError):
        return False
    return given.shape == (4,) and bool(np.allclose(given, own, rtol=0.02))


def _parsed(path: Path) -> dict[str, Any] | list[Any]:
    text = read_text(path)
    if not text.lstrip().startswith("["):
        return read_yaml(path)
    content = parsed_yaml(path, text)
    return content if isinstance(content, list) else {}


def _kalibr(path: Path, content: dict[str, Any], name: str, report: Report) -> tuple[Pose, float]:
    entry = content.get(name)
    mounted = kalibr_mounting(path, content, int(name[3:]), report) if isinstance(entry, dict) else None
    if mounted is None:
        raise fail(path, name, "expected T_cam_imu, a 4x4 matrix, as Kalibr's camchain-imucam has it")
    return mounted
