"""Matrices that cv2.FileStorage wrote, under the names that calibration programs usually give them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshslam.geometry import Floats
from meshslam.sequences.cameras.found import FoundCamera, brown, from_matrix, row_of, size_of
from meshslam.sequences.report import Report, fail

_MATRIX = ("camera_matrix", "cameramatrix", "k", "m", "intrinsic_matrix", "intrinsics", "mtx")
_LENS = ("distortion_coefficients", "distcoeffs", "distortion_coeffs", "dist_coeffs", "d", "distortion", "dist")
_WIDTH, _HEIGHT = ("image_width", "imagewidth", "width"), ("image_height", "imageheight", "height")
_SIZE = ("image_size", "imagesize", "resolution", "size", "calibimagesize")
_FISHEYE = ("fisheye_model", "fisheye", "is_fisheye")
_NUMBERS = {"": 0, "1": 1, "2": 2, "_1": 1, "_2": 2, "_left": 1, "_right": 2}  # by the end of a name


@dataclass(frozen=True)
class OpencvStorage:
    """See CameraFormat. Stereo files number their cameras 1 and 2."""

    name: str = "OpenCV FileStorage"

    def cameras(self, content: Mapping[str, Any]) -> dict[int, str]:
        """Every matrix that is called as intrinsic matrices are."""
        return {number: key for number, (key, _) in _matrices(content).items()}

    def read(self, path: Path, content: Mapping[str, Any], number: int, report: Report) -> FoundCamera:
        """One of them."""
        key, end = _matrices(content)[number]
        lens = _key(content, _LENS, end) or _key(content, _LENS)
        coefficients = row_of(path, lens or "distortion_coefficients", [] if lens is None else content[lens])
        model, coefficients = _model(path, content, coefficients, report)
        return FoundCamera(
            _size(path, content),
            from_matrix(path, key, content[key]),
            model,
            coefficients,
            (key, lens or "distortion_coefficients", lens or "distortion_coefficients"),
        )


def _matrices(content: Mapping[str, Any]) -> dict[int, tuple[str, str]]:
    """Key and end of its name by number; scalars such as k1 are no matrices, a list of four intrinsics neither."""
    found: dict[int, tuple[str, str]] = {}
    for end, number in _NUMBERS.items():
        key = _key(content, _MATRIX, end)
        kinds = dict if key == "intrinsics" else (dict, list)
        if key is not None and isinstance(content[key], kinds):
            found.setdefault(number, (key, end))
    return found


def _key(content: Mapping[str, Any], names: tuple[str, ...], end: str = "") -> str | None:
    wanted = [name + end for name in names]
    return next((key for name in wanted for key in content if key.lower() == name), None)


def _size(path: Path, content: Mapping[str, Any]) -> tuple[int, int] | None:
    wide, high, both = (_key(content, names) for names in (_WIDTH, _HEIGHT, _SIZE))
    if wide is not None and high is not None:
        return size_of(path, f"{wide}, {high}", [content[wide], content[high]])
    return None if both is None else size_of(path, both, content[both])


def _model(path: Path, content: Mapping[str, Any], coefficients: Floats, report: Report) -> tuple[str, Floats]:
    """A fisheye's where the file says so; four numbers without a word may be either, which is noted."""
    flag, named = _key(content, _FISHEYE), content.get("distortion_model")
    if named is not None and str(named) not in ("plumb_bob", "radtan", "rational_polynomial", "equidistant", "fisheye"):
        raise fail(path, "distortion_model", f"expected plumb_bob, radtan or equidistant, found {str(named)[:40]!r}")
    if named in ("equidistant", "fisheye") or (flag is not None and row_of(path, flag, content[flag]).any()):
        return "equidistant", coefficients
    if len(coefficients) == 4 and coefficients.any() and flag is None and named is None:
        said = "four coefficients are read as k1, k2, p1, p2; those of cv2.fisheye need fisheye_model: 1 in the file"
        report.note(path, "", said)
    return brown(coefficients)
