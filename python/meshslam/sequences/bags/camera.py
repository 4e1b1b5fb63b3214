"""A camera from CameraInfo, Foxglove's CameraCalibration, or a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import Camera, Floats
from meshslam.sequences.bags.index import field_of
from meshslam.sequences.distortion import Distortion
from meshslam.sequences.folder import CameraFile, read_camera_file
from meshslam.sequences.report import Report, fail

_RADTAN = ("plumb_bob", "radtan", "")


def camera_of_file(path: Path, size: tuple[int, int] | None, report: Report) -> CameraFile:
    """The camera of `--camera FILE`, for images of `size` (w, h) if that is given."""
    found = read_camera_file(path, report)
    own = found.camera
    if size is None or size == (own.width, own.height):
        return found
    raw = _scaled(own, size)
    bent = None if found.distortion is None else Distortion(raw, raw, found.distortion.coefficients)
    return CameraFile(raw, bent, found.imu_from_camera, found.height_above_ground_m)


def _scaled(camera: Camera, size: tuple[int, int]) -> Camera:
    """For the same view in other pixels, whose centres are whole numbers."""
    x, y = size[0] / camera.width, size[1] / camera.height
    cx, cy = (camera.cx + 0.5) * x - 0.5, (camera.cy + 0.5) * y - 0.5
    return Camera(*size, camera.fx * x, camera.fy * y, cx, cy, camera.skew * x)


def camera_of_info(path: Path, topic: str, info: Any, is_rectified: bool) -> CameraFile:  # noqa: ANN401 # by the schema
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
        bent = None if is_rectified else _distortion(path, topic, info, raw, d)
    except GeometryError as error:
        raise fail(path, topic, f"{error}: give --camera FILE") from None
    return CameraFile(raw, bent)


def _square(path: Path, topic: str, k: Floats) -> Floats:
    if len(k) != 9 or not np.isfinite(k).all():
        raise fail(path, topic, f"K has {len(k)} numbers, expected 9 that are finite: give --camera FILE")
    return k.reshape(3, 3)


def _distortion(path: Path, topic: str, info: Any, raw: Camera, d: Floats) -> Distortion | None:  # noqa: ANN401
    """None where there is none. The one place that knows ROS's names of lens models."""
    model = str(getattr(info, "distortion_model", ""))
    if not d.any():
        return None
    if model not in _RADTAN or len(d) not in (4, 5):
        what = f"the lens model {model!r:.40} with {len(d)} coefficients is not read, only plumb_bob with 4 or 5 is"
        raise fail(path, topic, f"{what}: undistort the images, or give --camera FILE")
    return Distortion(raw, raw, d)
