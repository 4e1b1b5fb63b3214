"""COLMAP's images.txt and images.bin: camera_from_world of each image, by its name."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import Pose
from meshslam.sequences.report import fail
from meshslam.sequences.text import read_text

_HEAD = struct.Struct("<i7di")  # id, quaternion with w first, translation, camera
_POINT_BYTES = 24
Some = TypeVar("Some")


def read_colmap_images(path: Path) -> dict[str, tuple[Pose, int]]:
    """camera_from_world and the camera's id, by the images' names, with their folders; FoundError for a damaged file.

    Each row of images.txt is followed by a line of points, which may be empty.
    """
    rows = _binary(path) if path.suffix == ".bin" else _text(path)
    found = {}
    for where, numbers, camera, name in rows:
        if not np.isfinite(numbers).all() or not 1e-6 < np.linalg.norm(numbers[:4]) < 1e6:
            raise fail(path, where, "expected a quaternion and a translation of finite numbers")
        try:
            pose = Pose.from_quaternion(numbers[:4] / np.linalg.norm(numbers[:4]), numbers[4:], order="wxyz")
        except GeometryError as error:
            raise fail(path, where, str(error)) from None
        name = name.replace("\\", "/")
        if name in found:
            raise fail(path, where, f"a second pose of {name[-60:]}")
        found[name] = (pose, camera)
    if not found:
        raise fail(path, "", "holds no images")
    return found


def by_file_name(path: Path, placed: Mapping[str, Some]) -> dict[str, Some]:
    """The same by names without folders; FoundError where two images are called alike."""
    found: dict[str, Some] = {}
    for name, value in placed.items():
        short = name.rpartition("/")[2]
        if short in found:
            raise fail(path, "", f"has two images that are called {short[-60:]}, in different folders")
        found[short] = value
    return found


def is_colmap_images(path: Path) -> bool:
    """Whether a file looks like one of the two."""
    if path.name == "images.bin":
        return True
    first = next((line.split() for line in read_text(path).splitlines() if line.strip() and line[0] != "#"), [])
    return len(first) == 10 and not _is_number(first[9])


def _text(path: Path) -> list[tuple[str, np.ndarray, int, str]]:
    rows, points_next = [], False
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if line.startswith("#"):
            continue
        words = line.split(maxsplit=9)
        if points_next:
            if len(words) == 10 and not _is_number(words[9].split()[-1]):
                what = "an image stands where the points of the one before it should: each image has two lines, the "
                raise fail(path, f"line {number}", what + "second may be empty")
            points_next = False
            continue
        if not words:
            continue
        try:
            rows.append((f"line {number}", np.array([float(w) for w in words[1:8]]), int(words[8]), words[9].strip()))
        except (ValueError, IndexError):
            expected = "expected IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"
            raise fail(path, f"line {number}", f"{expected}, found {line.strip()[:60]!r}") from None
        points_next = True
    return rows


def _binary(path: Path) -> list[tuple[str, np.ndarray, int, str]]:
    try:
        data = path.read_bytes()
        (count,), at = struct.unpack_from("<Q", data), 8
        rows = []
        for _ in range(min(count, len(data) // _HEAD.size)):
            id_, *numbers, camera = _HEAD.unpack_from(data, at)
            end = data.index(b"\0", at + _HEAD.size)
            name = data[at + _HEAD.size : end].decode()
            (points,) = struct.unpack_from("<Q", data, end + 1)
            at = end + 9 + _POINT_BYTES * points
            rows.append((f"image {id_}", np.array(numbers), camera, name))
    except OSError as error:
        raise fail(path, "", f"cannot be read: {error.strerror}") from None
    except (struct.error, ValueError):
        raise fail(path, "", "is no images.bin of COLMAP, or is cut") from None
    if len(rows) != count or at != len(data):
        raise fail(path, "", f"is cut: {len(rows)} of {count} images are whole")
    return rows


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
