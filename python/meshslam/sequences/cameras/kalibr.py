"""Kalibr's camchain YAML: cam0, cam1, … with camera_model, intrinsics, distortion_model and coefficients, T_cam_imu."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.sequences.cameras.found import FoundCamera, needed, row_of, size_of
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
        extrinsics, ahead_s = entry.get("T_cam_imu"), entry.get("timeshift_cam_imu")
        if extrinsics is not None and ahead_s:
            said = "the clocks' offset is no part of a camera: give the file as --imu-from-camera, too"
            report.note(path, f"{within}timeshift_cam_imu", said)
        return FoundCamera(
            None if entry.get("resolution") is None else size_of(path, f"{within}resolution", entry["resolution"]),
            np.array([fx, fy, cx, cy, 0.0]),
            _MODELS[given],
            row_of(path, f"{within}distortion_coeffs", entry.get("distortion_coeffs") or []),
            (f"{within}intrinsics", f"{within}distortion_model", f"{within}distortion_coeffs"),
            None if extrinsics is None else pose_of(path, f"{within}T_cam_imu", extrinsics, report).inverse(),
        )
