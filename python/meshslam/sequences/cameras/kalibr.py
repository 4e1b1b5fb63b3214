"""Kalibr's camchain YAML: cam0, cam1, … with camera_model, intrinsics, distortion_model and coefficients, T_cam_imu."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.geometry import Pose
from meshslam.sequences.cameras.found import FoundCamera, needed, number_of, row_of, size_of
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import pose_of

_MODELS = {"radtan": "radtan", "equidistant": "equidistant", "equi": "equidistant", "fov": "fov", "none": "none"}


@dataclass(frozen=True)
class Kalibr:
    """See CameraFormat."""

    name: str = "Kalibr camchain"

    def cameras(self, content: Mapping[str, Any]) -> dict[int, str]:
        """Every camN."""
        names = [str(k) for k, v in content.items() if str(k)[3:].isdecimal() and isinstance(v, dict)]
        return {int(name[3:]): name for name in sorted(names) if name.startswith("cam") and len(name) < 9}

    def read(self, path: Path, content: Mapping[str, Any], number: int, report: Report) -> FoundCamera:
        """One of them; its IMU's clock offset is noted, as a camera has none."""
        name, entry = next((name, content[name]) for n, name in self.cameras(content).items() if n == number)
        within = f"{name}: "
        kind = entry.get("camera_model", "pinhole")
        if kind != "pinhole":
            raise fail(
                path, f"{within}camera_model", f"expected pinhole, found {str(kind)[:40]!r}: calibrate it as one"
            )
        fx, fy, cx, cy = row_of(path, f"{within}intrinsics", needed(path, entry, "intrinsics", within), 4)
        given = str(entry.get("distortion_model") or "none")
        if given not in _MODELS:
            raise fail(path, f"{within}distortion_model", f"expected {', '.join(_MODELS)}, found {given[:40]!r}")
        mounted = kalibr_mounting(path, content, number, report)
        return FoundCamera(
            None if entry.get("resolution") is None else size_of(path, f"{within}resolution", entry["resolution"]),
            np.array([fx, fy, cx, cy, 0.0]),
            _MODELS[given],
            row_of(path, f"{within}distortion_coeffs", entry.get("distortion_coeffs") or []),
            (f"{within}intrinsics", f"{within}distortion_model", f"{within}distortion_coeffs"),
            None if mounted is None else mounted[0],
            (f"{within}timeshift_cam_imu", 0.0 if mounted is None else mounted[1]),
        )


def kalibr_mounting(path: Path, content: Mapping[str, Any], number: int, report: Report) -> tuple[Pose, float] | None:
    """imu_from_camera of camera N, and by how many seconds the IMU's clock is ahead of it; None where it is not known.

    Where T_cam_imu is given of another camera of the chain alone, T_cn_cnm1 leads there: T_cn_cnm1 of camera N takes
    coordinates in camera N - 1 to camera N. Cameras of a chain are taken to expose together.
    """
    own = _with_extrinsics(content, number)
    if own is None:
        return None
    name, entry = f"cam{own}", content[f"cam{own}"]
    camera_from_imu = pose_of(path, f"{name}: T_cam_imu", entry["T_cam_imu"], report)
    for step in range(own + 1, number + 1):
        camera_from_imu = _neighbour(path, content, step, report) @ camera_from_imu
    for step in range(own, number, -1):
        camera_from_imu = _neighbour(path, content, step, report).inverse() @ camera_from_imu
    if own != number:
        first, last = sorted((own, number))
        steps = ", ".join(f"cam{step}" for step in range(first + 1, last + 1))
        report.note(path, f"cam{number}", f"its T_cam_imu is composed of that of {name} and T_cn_cnm1 of {steps}")
    ahead_s = number_of(path, f"{name}: timeshift_cam_imu", entry.get("timeshift_cam_imu", 0.0))
    return camera_from_imu.inverse(), ahead_s


def _with_extrinsics(content: Mapping[str, Any], number: int) -> int | None:
    """The camera whose T_cam_imu leads to that of `number`: its own, else the nearest that the chain reaches."""
    first, last = number, number
    while first > 0 and _entry(content, first).get("T_cn_cnm1") is not None:
        first -= 1
    while _entry(content, last + 1).get("T_cn_cnm1") is not None:
        last += 1
    known = [n for n in range(first, last + 1) if _entry(content, n).get("T_cam_imu") is not None]
    return min(known, key=lambda n: (abs(n - number), n), default=None)


def _entry(content: Mapping[str, Any], number: int) -> Mapping[str, Any]:
    entry = content.get(f"cam{number}")
    return entry if isinstance(entry, dict) else {}


def _neighbour(path: Path, content: Mapping[str, Any], number: int, report: Report) -> Pose:
    return pose_of(path, f"cam{number}: T_cn_cnm1", _entry(content, number)["T_cn_cnm1"], report)
