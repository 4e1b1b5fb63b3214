"""What KITTI's layouts share: calibration files of `key: numbers`, projection matrices, the height of the cameras."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import Camera, Floats, Pose
from meshslam.sequences.report import IncompleteError, Report, fail
from meshslam.sequences.text import LARGEST, read_text

CAMERA_NUMBERS = (0, 1, 2, 3)
HEIGHT_ABOVE_GROUND_M = 1.65  # Geiger et al., Vision meets Robotics: The KITTI Dataset, IJRR 2013, Fig. 3


def read_calibration(path: Path, sizes: dict[str, int], report: Report) -> dict[str, Floats]:
    """Read the keys of `sizes`, each with so many finite numbers; every key that is missing or wrong is reported."""
    found = dict(line.partition(":")[::2] for line in read_text(path).splitlines() if ":" in line)
    values = {}
    for key, size in sizes.items():
        if key not in found:
            report.add(path, key, f"key is missing, expected {size} numbers")
            continue
        value = report.attempt(partial(_parse, path, key, found[key], size))
        if value is not None:
            values[key] = value
    if len(values) < len(sizes):
        raise IncompleteError(f"{path}: {sorted(sizes.keys() - values.keys())} missing")
    return values


def _parse(path: Path, key: str, text: str, size: int) -> Floats:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        raise fail(path, key, f"expected {size} numbers, found {text.strip()[:80]!r}") from None
    if len(values) != size or not (np.abs(values) < LARGEST).all():
        raise fail(path, key, f"expected {size} finite numbers, found {text.strip()[:80]!r}")
    return values


def split_projection(path: Path, key: str, values: Floats, size: tuple[int, int]) -> tuple[Camera, Pose]:
    """Split a projection P = K [I | t] of a rectified camera: the camera, and camera_from_rectified (camera 0)."""
    projection = values.reshape(3, 4)
    (fx, skew, cx), (_, fy, cy) = projection[0, :3], projection[1, :3]
    try:
        camera = Camera(size[0], size[1], float(fx), float(fy), float(cx), float(cy), float(skew))
    except GeometryError as error:
        raise fail(path, key, str(error)) from None
    offset: Floats = np.linalg.solve(camera.matrix, projection[:, 3]).astype(np.float64)
    return camera, Pose(np.eye(3), offset)
