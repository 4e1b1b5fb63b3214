"""What every format hands over, and how it becomes a camera file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import Camera, Floats, Pose
from meshslam.sequences.calibration import distortion_of
from meshslam.sequences.folder import CameraFile
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import numbers_of

LARGEST_SIZE_PX = 100_000  # width or height


@dataclass(frozen=True, eq=False)
class FoundCamera:
    """One camera of a file, in our pixel convention: (0, 0) is the centre of the first pixel."""

    size: tuple[int, int] | None  # width, height; None: the file does not say
    intrinsics: Floats  # fx, fy, cx, cy, skew: px
    model: str = "none"  # as distortion_model of camera.yaml
    coefficients: Floats = field(default_factory=lambda: np.zeros(0))
    keys: tuple[str, str, str] = ("intrinsics", "distortion_model", "distortion_coeffs")  # where these stand
    imu_from_camera: Pose | None = None
    imu_ahead: tuple[str, float] = ("", 0.0)  # key and seconds by which the IMU's clock is ahead of the camera's


class CameraFormat(Protocol):
    """Reads one format of calibration files that are mappings."""

    @property
    def name(self) -> str:
        """What the format is called."""

    def cameras(self, content: Mapping[str, Any]) -> dict[int, str]:
        """Names of the cameras by their numbers; empty for a file of another format."""

    def read(self, path: Path, content: Mapping[str, Any], number: int, report: Report) -> FoundCamera:
        """Read one of them; FoundError for what is missing or wrong."""


def camera_file(path: Path, found: FoundCamera, size: tuple[int, int] | None, report: Report) -> CameraFile:
    """The camera with its lens, its intrinsics scaled to images of `size`."""
    key, ahead_s = found.imu_ahead
    if ahead_s:
        report.note(path, key, "the clocks' offset is no part of a camera: give the file as --imu-from-camera, too")
    raw = _raw_camera(path, found, size, report)
    distortion = distortion_of(path, found.keys[1:], found.model, found.coefficients, raw, report)
    return CameraFile(raw if distortion is None else distortion.camera, distortion, found.imu_from_camera)


def _raw_camera(path: Path, found: FoundCamera, size: tuple[int, int] | None, report: Report) -> Camera:
    own, (fx, fy, cx, cy, skew) = found.size or size, (float(value) for value in found.intrinsics)
    if own is None:
        raise fail(path, "", "does not say of which image size it is: give --size WIDTHxHEIGHT, px")
    try:
        camera = Camera(*own, fx, fy, cx, cy, skew)
        return camera if size is None or size == own else _scaled(path, camera, size, report)
    except GeometryError as error:
        raise fail(path, found.keys[0], str(error)) from None


def _scaled(path: Path, camera: Camera, size: tuple[int, int], report: Report) -> Camera:
    """The camera of the same images at another size; FoundError where that is no uniform scale, within a pixel."""
    own = camera.width, camera.height
    if min(size) < 1 or abs(size[0] * own[1] - size[1] * own[0]) > max(*own, *size):
        raise fail(
            path,
            "",
            f"is of images of {own[0]}x{own[1]}, which do not scale to {size[0]}x{size[1]}: cropped, or another "
            f"camera's? scale the images to {own[0]}:{own[1]}, or give --size WIDTHxHEIGHT of them",
        )
    by_x, by_y = size[0] / own[0], size[1] / own[1]
    report.note(path, "", f"intrinsics of {own[0]}x{own[1]} are scaled to images of {size[0]}x{size[1]}")
    centre = (camera.cx + 0.5) * by_x - 0.5, (camera.cy + 0.5) * by_y - 0.5
    return Camera(*size, camera.fx * by_x, camera.fy * by_y, *centre, camera.skew * by_x)


def size_of(path: Path, key: str, value: object) -> tuple[int, int]:
    """Width and height in whole pixels."""
    values = numbers_of(path, key, value).reshape(-1)
    whole = len(values) == 2 and (values == np.round(values)).all() and values.min() >= 1
    if not whole or values.max() > LARGEST_SIZE_PX:
        raise fail(path, key, f"expected [width, height] in whole pixels, found {str(values.tolist())[:80]}")
    return int(values[0]), int(values[1])


def needed(path: Path, content: Mapping[str, Any], key: str, within: str = "") -> object:
    """The value of a key; FoundError where it is missing."""
    if content.get(key) is None:
        raise fail(path, within + key, "key is missing")
    return content[key]


def row_of(path: Path, key: str, value: object, count: int | None = None) -> Floats:
    """Finite numbers in one row, `count` of them if given."""
    values = numbers_of(path, key, value).reshape(-1)
    if count is not None and len(values) != count:
        raise fail(path, key, f"expected {'one number' if count == 1 else f'{count} numbers'}, found {len(values)}")
    return values


def number_of(path: Path, key: str, value: object) -> float:
    """One finite number."""
    return float(row_of(path, key, value, 1)[0])


def from_matrix(path: Path, key: str, value: object) -> Floats:
    """fx, fy, cx, cy, skew of a 3 × 3 intrinsic matrix."""
    matrix = row_of(path, key, value, 9).reshape(3, 3)
    rest = matrix[[1, 2, 2, 2], [0, 0, 1, 2]]
    if np.abs(rest - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
        raise fail(path, key, "expected [fx, skew, cx; 0, fy, cy; 0, 0, 1]: is it transposed, or another matrix?")
    return matrix[[0, 1, 0, 1, 0], [0, 1, 2, 2, 1]]


def brown(coefficients: Floats) -> tuple[str, Floats]:
    """The model and coefficients that OpenCV's list of 0, 4, 5, 8, 12 or 14 numbers means.

    Thin prism and tilt are no part of our models: with such parts the list stays as long as it is, and is refused.
    """
    if len(coefficients) > 8 and not coefficients[8:].any():
        coefficients = coefficients[:8]
    if len(coefficients) == 8 and not coefficients[5:].any():
        coefficients = coefficients[:5]
    if not coefficients.any() and len(coefficients) in (0, 4, 5):
        return "none", np.zeros(0)
    return ("radtan" if len(coefficients) < 6 else "rational"), coefficients
