"""KITTI-360's perspective.txt and KITTI raw's calib_cam_to_cam.txt: the rectified cameras' P_rect and S_rect."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from meshslam.sequences.cameras.found import FoundCamera, size_of
from meshslam.sequences.kitti import read_calibration
from meshslam.sequences.report import Report

_KEY = re.compile(r"^P_rect_(\d\d):", re.MULTILINE)


def rectified_cameras(text: str) -> dict[int, str]:
    """Names by number, such as {0: "P_rect_00"}; empty for another file."""
    return {int(number): f"P_rect_{number}" for number in _KEY.findall(text)}


def read_rectified(path: Path, number: int, report: Report) -> FoundCamera:
    """One of them: images must be the rectified ones, which have no distortion."""
    matrix, size = f"P_rect_{number:02d}", f"S_rect_{number:02d}"
    values = read_calibration(path, {matrix: 12, size: 2}, report)
    projection = values[matrix].reshape(3, 4)
    intrinsics: np.ndarray = projection[[0, 1, 0, 1, 0], [0, 1, 2, 2, 1]]
    return FoundCamera(size_of(path, size, values[size]), intrinsics, keys=(matrix, matrix, matrix))
