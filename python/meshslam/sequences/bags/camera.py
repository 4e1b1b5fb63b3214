"""A camera from CameraInfo or Foxglove's CameraCalibration."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import Camera, Floats
from meshslam.sequences.bags.index import field_of
from meshslam.sequences.calibration import distortion_of
from meshslam.sequences.folder import CameraFile
from meshslam.sequences.report import Report, fail

_MODELS = {  # ROS' names, and Foxglove's, of our lens models
    "": "radtan",
    "plumb_bob": "radtan",
    "radtan": "radtan",
    "rational_polynomial": "rational",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
    "kannala_brandt": "equidistant",
}

_RECTIFIED = re.compile(r"(/|_)rect(ified)?(_|/|$)")


def is_rectified_topic(name: str) -> bool:
    """Whether the images of a topic are rectified, by its name.

    >>> is_rectified_topic("/camera/image_rect_color"), is_rectified_topic("/camera/image_raw")
    (True, False)
    """
    return _RECTIFIED.search(name) is not None


def camera_of_info(  # by the schema
    path: Path,
    topic: str,
    info: Any,  # noqa: ANN401
    is_rectified: bool,
    report: Report,
) -> CameraFile:
    """The camera of a calibration message: K and D, or P where the images are rectified; FoundError if it is none."""
    try:
        k, d, p = (field_of(info, name) for name in ("k", "d", "p"))
        width, height = int(info.width), int(info.height)
    except (AttributeError, TypeError, ValueError):
        raise fail(path, topic, "a calibration without width, height and K: give --camera FILE") from None
    matrix = p.reshape(3, 4)[:, :3] if is_rectified and len(p) == 12 and p.any() else _square(path, topic, k)
    if not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise fail(path, topic, "the camera is not calibrated: K is zero: give --camera FILE")
    try:
        raw = Camera(width, height, *(float(matrix[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2), (0, 1))))
    except GeometryError as error:
        raise fail(path, topic, f"{error}: give --camera FILE") from None
    if is_rectified or not d.any():
        return CameraFile(raw)
    model = str(getattr(info, "distortion_model", ""))
    if model not in _MODELS:
        known = ", ".join(name for name in _MODELS if name)
        raise fail(path, topic, f"the lens model {model!r:.40} is not read, only {known}: give --camera FILE")
    bent = distortion_of(path, (topic, "D"), _MODELS[model], d, raw, report)
    return CameraFile(raw if bent is None else bent.camera, bent)


def _square(path: Path, topic: str, k: Floats) -> Floats:
    if len(k) != 9 or not np.isfinite(k).all():
        raise fail(path, topic, f"K has {len(k)} numbers, expected 9 that are finite: give --camera FILE")
    return k.reshape(3, 3)
