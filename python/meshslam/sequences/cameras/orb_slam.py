"""ORB-SLAM2's and ORB-SLAM3's settings: Camera.fx or Camera1.fx, their coefficients, Tbc or IMU.T_b_c1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.geometry import Pose
from meshslam.sequences.cameras.found import FoundCamera, brown, from_matrix, needed, number_of, row_of, size_of
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import pose_of

_GROUPS = {"Camera1": 1, "Camera": 1, "Camera2": 2}  # the left one, alone or not, and the right one
_RAW = {"LEFT": 1, "RIGHT": 2}  # ORB-SLAM2's stereo files: raw cameras beside the rectified Camera.fx
_PINHOLE, _FISHEYE = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), ("k1", "k2", "k3", "k4")


@dataclass(frozen=True)
class OrbSlam:
    """See CameraFormat. Camera 1 is the left one, 2 the right one."""

    name: str = "ORB-SLAM settings"

    def cameras(self, content: Mapping[str, Any]) -> dict[int, str]:
        """Those that have a focal length; of ORB-SLAM2's stereo files the raw ones."""
        raw = {number: f"{side}.K" for side, number in _RAW.items() if f"{side}.K" in content}
        found: dict[int, str] = {}
        for group, number in _GROUPS.items():
            if f"{group}.fx" in content:
                found.setdefault(number, group)
        return raw or found

    def read(self, path: Path, content: Mapping[str, Any], number: int, report: Report) -> FoundCamera:
        """One of them; the body is the IMU."""
        group = self.cameras(content)[number]
        if group.endswith(".K"):
            return _raw(path, content, group.removesuffix(".K"))
        fx, fy, cx, cy = (_number(path, content, f"{group}.{key}") for key in ("fx", "fy", "cx", "cy"))
        model, coefficients = _lens(path, content, group)
        return FoundCamera(
            _size(path, content, "Camera.width", "Camera.height"),
            np.array([fx, fy, cx, cy, 0.0]),
            model,
            coefficients,
            (f"{group}.fx", "Camera.type", f"{group}.k1"),
            _mounting(path, content, number, report),
        )


def _lens(path: Path, content: Mapping[str, Any], group: str) -> tuple[str, np.ndarray]:
    """ORB-SLAM2 has pinholes alone and does not say so; a rectified camera has no coefficients."""
    kind = str(content.get("Camera.type", "PinHole"))
    if kind.lower() == "rectified":
        return "none", np.zeros(0)
    if kind.lower() == "kannalabrandt8":
        return "equidistant", np.array([_number(path, content, f"{group}.{key}") for key in _FISHEYE])
    if kind.lower() != "pinhole":
        raise fail(path, "Camera.type", f"expected PinHole, KannalaBrandt8 or Rectified, found {kind[:40]!r}")
    given = [key for key in _PINHOLE if content.get(f"{group}.{key}") is not None]
    values = [_number(path, content, f"{group}.{key}") if key in given else 0.0 for key in _PINHOLE]
    count = next(n for n in (4, 5, 8) if set(given) <= set(_PINHOLE[:n]))
    return brown(np.array(values[:count]))


def _raw(path: Path, content: Mapping[str, Any], side: str) -> FoundCamera:
    """The camera before ORB-SLAM2 rectifies its images itself."""
    coefficients = row_of(path, f"{side}.D", content.get(f"{side}.D") or [])
    model, coefficients = brown(coefficients)
    return FoundCamera(
        _size(path, content, f"{side}.width", f"{side}.height"),
        from_matrix(path, f"{side}.K", content[f"{side}.K"]),
        model,
        coefficients,
        (f"{side}.K", f"{side}.D", f"{side}.D"),
    )


def _mounting(path: Path, content: Mapping[str, Any], number: int, report: Report) -> Pose | None:
    """imu_from_camera: of the right camera by way of the left one, or unknown."""
    key = next((key for key in ("IMU.T_b_c1", "Tbc") if content.get(key) is not None), None)
    if key is None:
        return None
    imu_from_left = pose_of(path, key, content[key], report)
    if number == 1:
        return imu_from_left
    stereo = next((key for key in ("Stereo.T_c1_c2", "Tlr") if content.get(key) is not None), None)
    if stereo is None:
        return None
    matrix = row_of(path, stereo, content[stereo])
    if len(matrix) not in (12, 16):
        raise fail(path, stereo, f"expected a 3x4 or 4x4 matrix, found {len(matrix)} numbers")
    square = np.vstack([matrix[:12].reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
    return imu_from_left @ pose_of(path, stereo, square.tolist(), report)


def _size(path: Path, content: Mapping[str, Any], wide: str, high: str) -> tuple[int, int] | None:
    if content.get(wide) is None and content.get(high) is None:
        return None
    return size_of(path, f"{wide}, {high}", [needed(path, content, key) for key in (wide, high)])


def _number(path: Path, content: Mapping[str, Any], key: str) -> float:
    return number_of(path, key, needed(path, content, key))
