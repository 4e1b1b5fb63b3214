"""ROS' camera_info: the YAML of camera_calibration, and what `topic echo` prints of the message (K or k, D or d)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.geometry import Floats
from meshslam.sequences.cameras.found import FoundCamera, brown, from_matrix, needed, row_of, size_of
from meshslam.sequences.report import Report, fail

_MODELS = ("plumb_bob", "rational_polynomial", "equidistant", "fisheye")


@dataclass(frozen=True)
class RosInfo:
    """See CameraFormat."""

    name: str = "ROS camera_info"

    def cameras(self, content: Mapping[str, Any]) -> dict[int, str]:
        """The one camera."""
        of_file = "camera_matrix" in content and "distortion_model" in content
        of_message = "distortion_model" in content and ("K" in content or "k" in content)
        return {0: str(content.get("camera_name") or "the camera")[:40]} if of_file or of_message else {}

    def read(self, path: Path, content: Mapping[str, Any], number: int, report: Report) -> FoundCamera:
        """Read it: the raw image's matrix and coefficients, not the rectified image's."""
        matrix = next(key for key in ("camera_matrix", "K", "k") if key in content)
        listed = next(
            (key for key in ("distortion_coefficients", "D", "d") if key in content), "distortion_coefficients"
        )
        wide, high = ("image_width", "image_height") if "image_width" in content else ("width", "height")
        size = (needed(path, content, wide), needed(path, content, high))
        for key in ("binning_x", "binning_y"):
            if content.get(key) not in (None, 0, 1):
                raise fail(path, key, "binned images are of another size: give a camera_info of these images")
        model, coefficients = _lens(path, content, row_of(path, listed, _data(content.get(listed))))
        return FoundCamera(
            size_of(path, f"{wide}, {high}", list(size)),
            from_matrix(path, matrix, _data(content[matrix])),
            model,
            coefficients,
            (matrix, "distortion_model", listed),
        )


def _lens(path: Path, content: Mapping[str, Any], coefficients: Floats) -> tuple[str, Floats]:
    given = str(content.get("distortion_model") or "")
    if given and given not in _MODELS:
        raise fail(path, "distortion_model", f"expected {', '.join(_MODELS)}, found {given[:40]!r}")
    if given in ("equidistant", "fisheye"):
        return "equidistant", coefficients
    if given == "rational_polynomial" and len(coefficients) < 8:
        coefficients = np.concatenate([coefficients, np.zeros(8 - len(coefficients))])
    return brown(coefficients)


def _data(value: object) -> object:
    return [] if value is None else value
