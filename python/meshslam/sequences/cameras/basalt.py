"""Basalt's calibration: JSON with value0: T_imu_cam, intrinsics with a camera_type each, resolution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import Pose
from meshslam.sequences.cameras.found import FoundCamera, brown, needed, number_of, size_of
from meshslam.sequences.report import Report, fail

_KEYS: dict[str, tuple[str, ...]] = {  # coefficients behind the intrinsics, in the order of our models
    "pinhole": (),
    "pinhole-radtan8": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "kb4": ("k1", "k2", "k3", "k4"),
    "fov": ("w",),
}


@dataclass(frozen=True)
class Basalt:
    """See CameraFormat. Cameras are numbered from 0, as in the lists."""

    name: str = "Basalt calibration"

    def cameras(self, content: Mapping[str, Any]) -> dict[int, str]:
        """Every entry of value0's intrinsics."""
        entries = _list(_value0(content).get("intrinsics"))
        kinds = [e.get("camera_type") if isinstance(e, dict) else None for e in entries]
        return {number: str(kind)[:40] for number, kind in enumerate(kinds)}

    def read(self, path: Path, content: Mapping[str, Any], number: int, report: Report) -> FoundCamera:
        """One of them; T_imu_cam is imu_from_camera."""
        inner, within = _value0(content), f"intrinsics {number}: "
        entry = inner["intrinsics"][number]
        kind = str(needed(path, entry if isinstance(entry, dict) else {}, "camera_type", within))
        if kind not in _KEYS:
            raise fail(
                path, f"{within}camera_type", f"{kind[:40]!r} is not read, only {', '.join(_KEYS)}: calibrate as one"
            )
        values = needed(path, entry, "intrinsics", within)
        if not isinstance(values, dict):
            raise fail(path, f"{within}intrinsics", "expected the keys fx, fy, cx, cy")
        numbers = [_number(path, values, key, within) for key in ("fx", "fy", "cx", "cy", *_KEYS[kind])]
        model, coefficients = _lens(kind, np.array(numbers[4:]))
        sizes = _list(inner.get("resolution"))
        ahead_ns = number_of(path, "cam_time_offset_ns", inner.get("cam_time_offset_ns") or 0.0)
        return FoundCamera(
            size_of(path, f"resolution {number}", sizes[number]) if len(sizes) > number else None,
            np.array([*numbers[:4], 0.0]),
            model,
            coefficients,
            (f"{within}intrinsics", f"{within}camera_type", f"{within}intrinsics"),
            _mounting(path, inner, number),
            ("cam_time_offset_ns", ahead_ns * 1e-9),
        )


def _lens(kind: str, values: np.ndarray) -> tuple[str, np.ndarray]:
    return {"kb4": ("equidistant", values), "fov": ("fov", values)}.get(kind) or brown(values)


def _mounting(path: Path, inner: Mapping[str, Any], number: int) -> Pose | None:
    poses = _list(inner.get("T_imu_cam"))
    if len(poses) <= number:
        return None
    where = f"T_imu_cam {number}: "
    if not isinstance(poses[number], dict):
        raise fail(path, where.rstrip(": "), "expected the keys px, py, pz, qx, qy, qz, qw")
    row = np.array([_number(path, poses[number], key, where) for key in ("px", "py", "pz", "qx", "qy", "qz", "qw")])
    try:
        return Pose.from_quaternion(row[3:], row[:3], order="xyzw")
    except GeometryError as error:
        raise fail(path, where.rstrip(": "), str(error)) from None


def _number(path: Path, part: Mapping[str, Any], key: str, within: str) -> float:
    return number_of(path, f"{within}{key}", needed(path, part, key, within))


def _value0(content: Mapping[str, Any]) -> Mapping[str, Any]:
    inner = content.get("value0")
    return inner if isinstance(inner, dict) else {}


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []
