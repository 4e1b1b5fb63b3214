"""EuRoC's and TUM-VI's sensor.yaml of a camera: T_BS is body from sensor, and the body is the IMU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.sequences.cameras.found import FoundCamera, needed, row_of, size_of
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import pose_of

_MODELS = {"radial-tangential": "radtan", "radtan": "radtan", "equidistant": "equidistant", "none": "none"}


@dataclass(frozen=True)
class Euroc:
    """See CameraFormat."""

    name: str = "EuRoC sensor.yaml"

    def cameras(self, content: Mapping[str, Any]) -> dict[int, str]:
        """The one camera."""
        return {0: "the camera"} if "T_BS" in content or "sensor_type" in content else {}

    def read(self, path: Path, content: Mapping[str, Any], number: int, report: Report) -> FoundCamera:
        """Read it."""
        if content.get("sensor_type", "camera") != "camera":
            raise fail(path, "sensor_type", f"expected camera, found {str(content['sensor_type'])[:40]!r}")
        if content.get("camera_model", "pinhole") != "pinhole":
            raise fail(path, "camera_model", f"expected pinhole, found {str(content['camera_model'])[:40]!r}")
        fx, fy, cx, cy = row_of(path, "intrinsics", needed(path, content, "intrinsics"), 4)
        given = str(content.get("distortion_model") or "none")
        if given not in _MODELS:
            raise fail(path, "distortion_model", f"expected {', '.join(_MODELS)}, found {given[:40]!r}")
        mounted = content.get("T_BS")
        return FoundCamera(
            None if content.get("resolution") is None else size_of(path, "resolution", content["resolution"]),
            np.array([fx, fy, cx, cy, 0.0]),
            _MODELS[given],
            row_of(path, "distortion_coefficients", content.get("distortion_coefficients") or []),
            ("intrinsics", "distortion_model", "distortion_coefficients"),
            None if mounted is None else pose_of(path, "T_BS", mounted, report),
        )
