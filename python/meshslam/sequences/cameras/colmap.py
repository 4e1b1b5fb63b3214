"""COLMAP's cameras.txt and cameras.bin. Its pixel (0.5, 0.5) is the centre of the first one, which is (0, 0) here."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.geometry import Floats
from meshslam.sequences.cameras.found import FoundCamera, brown, size_of
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import LARGEST

_MODELS: dict[str, tuple[int, int, Callable[[Floats], tuple[str, Floats]] | None]] = {
    # the binary file's number, how many parameters, the lens of those behind the intrinsics
    "SIMPLE_PINHOLE": (0, 3, brown),
    "PINHOLE": (1, 4, brown),
    "SIMPLE_RADIAL": (2, 4, lambda k: brown(np.array([k[0], 0.0, 0.0, 0.0]))),
    "RADIAL": (3, 5, lambda k: brown(np.array([*k, 0.0, 0.0]))),
    "OPENCV": (4, 8, brown),
    "OPENCV_FISHEYE": (5, 8, lambda k: ("equidistant", k)),
    "FULL_OPENCV": (6, 12, brown),
    "FOV": (7, 5, lambda k: ("fov", k)),
    "SIMPLE_RADIAL_FISHEYE": (8, 4, lambda k: ("equidistant", np.array([k[0], 0.0, 0.0, 0.0]))),
    "RADIAL_FISHEYE": (9, 5, lambda k: ("equidistant", np.array([*k, 0.0, 0.0]))),
    "THIN_PRISM_FISHEYE": (10, 12, lambda k: _thin_prism(k)),
    "RAD_TAN_THIN_PRISM_FISHEYE": (11, 16, None),
    "SIMPLE_DIVISION": (12, 4, None),
    "DIVISION": (13, 5, None),
    "SIMPLE_FISHEYE": (14, 3, lambda _: ("equidistant", np.zeros(4))),
    "FISHEYE": (15, 4, lambda _: ("equidistant", np.zeros(4))),
    "EUCM": (16, 6, None),
    "EQUIRECTANGULAR": (17, 2, None),
}
_ADVICE = "make the project pinhole by colmap image_undistorter"
_ONE_FOCAL = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_FISHEYE")
_ROW = re.compile(r"^\s*(\d{1,9})\s+([A-Z][A-Z_]+)\s+(\S+)\s+(\S+)\s+(.*\S)\s*$")


def _thin_prism(k: Floats) -> tuple[str, Floats]:
    """k1, k2, p1, p2, k3, k4, sx1, sy1: a fisheye where the prism's and the tangential parts are zero."""
    return ("equidistant", k[[0, 1, 4, 5]]) if not k[[2, 3, 6, 7]].any() else ("thin prism", k)


@dataclass(frozen=True, eq=False)
class ColmapCamera:
    """One row of the file."""

    where: str
    model: str
    size: tuple[object, object]
    parameters: tuple[object, ...]


def from_text(path: Path, text: str) -> dict[int, ColmapCamera]:
    """Rows of cameras.txt by the camera's id; empty for another file; FoundError for a row that is none."""
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"]
    rows = [(n, _ROW.match(line)) for n, line in lines]
    if "CAMERA_ID" not in text and not any(row for _, row in rows):
        return {}
    found = {}
    for number, row in rows:
        if row is None:
            raise fail(
                path, f"line {number}", "expected CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS, as COLMAP writes them"
            )
        id_, model, width, height, rest = row.groups()
        if int(id_) in found:
            raise fail(path, f"line {number}", f"a second camera {id_}")
        found[int(id_)] = ColmapCamera(f"line {number}", model, (width, height), tuple(rest.split()))
    return found


def from_binary(path: Path, data: bytes) -> dict[int, ColmapCamera]:
    """Rows of cameras.bin by the camera's id; empty for another file; FoundError for one that is cut or unknown."""
    names = {id_: (name, count) for name, (id_, count, _) in _MODELS.items()}
    try:
        (count,), at, found = struct.unpack_from("<Q", data), 8, {}
        for _ in range(min(count, len(data))):
            id_, kind, width, height = struct.unpack_from("<iiQQ", data, at)
            if kind not in names:
                raise fail(path, f"camera {id_}", f"a model of the number {kind} is not known: {_ADVICE}")
            name, size = names[kind]
            values = struct.unpack_from(f"<{size}d", data, at + 24)
            if id_ in found:
                raise fail(path, f"camera {id_}", "comes twice")
            found[id_] = ColmapCamera(f"camera {id_}", name, (width, height), values)
            at += 24 + 8 * size
    except struct.error:
        raise fail(path, "", "is cut: not all of its cameras are whole: copy it anew") from None
    if at != len(data):
        raise fail(path, "", f"{len(data) - at} bytes stand behind its {count} cameras: is it COLMAP's cameras.bin?")
    return found


def to_found(path: Path, camera: ColmapCamera, report: Report) -> FoundCamera:
    """The camera in our pixels; FoundError for an unknown model, or another count of parameters."""
    _, count, lens = _MODELS.get(camera.model, (0, 0, None))
    if lens is None:
        known = ", ".join(name for name, (_, _, read) in _MODELS.items() if read is not None)
        raise fail(path, camera.where, f"the model {camera.model[:40]} is not read ({_ADVICE}), only {known}")
    values = _numbers(path, camera, count)
    focal = 1 if camera.model in _ONE_FOCAL else 2
    (cx, cy), rest = values[focal : focal + 2] - 0.5, values[focal + 2 :]
    model, coefficients = lens(rest)
    if model == "thin prism":
        raise fail(path, camera.where, f"{camera.model} is read where p1, p2, sx1, sy1 are zero alone: {_ADVICE}")
    return FoundCamera(
        size_of(path, camera.where, list(camera.size)),
        np.array([values[0], values[focal - 1], cx, cy, 0.0]),
        model,
        coefficients,
        (camera.where,) * 3,
    )


def _numbers(path: Path, camera: ColmapCamera, count: int) -> Floats:
    try:
        values = np.array([float(str(word)) for word in camera.parameters])
    except ValueError:
        raise fail(path, camera.where, f"expected {count} parameters that are numbers") from None
    if len(values) != count or not (np.abs(values) < LARGEST).all():
        raise fail(path, camera.where, f"{camera.model} has {count} finite parameters, found {len(values)} numbers")
    return values
