"""What the converters know of the recording, and how they put detections together."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from meshslam.errors import DetectionError
from meshslam.geometry import Bytes
from meshslam.perception.detections import CategoryEntry, Detection, DetectionSet, ImageEntry
from meshslam.perception.masks import Segmentation, decode_segmentation


@dataclass(frozen=True)
class ImageFrames:
    """Frame numbers of a recording and the size of its images, px."""

    numbers: tuple[int, ...]
    width: int
    height: int

    def known(self, number: int, where: str) -> int:
        """The number, if there is such a frame; DetectionError otherwise."""
        if number not in self.numbers:
            span = f"{self.numbers[0]} to {self.numbers[-1]}" if self.numbers else "none"
            raise DetectionError(f"{where}: frame {number}: the recording's frames are {span}")
        return number


@dataclass(frozen=True, eq=False)
class Found:
    """One detection on its way in."""

    frame: int
    category: str
    score: float
    segmentation: Segmentation
    track_id: int | None = None


def gathered(found: Iterable[Found], frames: ImageFrames, names: Sequence[str] = ()) -> DetectionSet:
    """A set with ids in the order of the frames; empty masks are left out. `names` come first among the categories."""
    rows = sorted(found, key=lambda f: f.frame)
    listed = list(dict.fromkeys([*names, *(f.category for f in rows)]))
    size = (frames.height, frames.width)
    detections: list[Detection] = []
    for row in rows:
        x, y, w, h = cv2.boundingRect(decode_segmentation(row.segmentation, *size))
        if w and h:
            box = (float(x), float(y), float(w), float(h))
            number = len(detections) + 1
            detections.append(
                Detection(
                    number, row.frame, row.category, row.score, box, row.segmentation, size, track_id=row.track_id
                )
            )
    images = tuple(ImageEntry(n, f"{n:06d}.png", frames.width, frames.height) for n in sorted(frames.numbers))
    categories = tuple(CategoryEntry(i + 1, name) for i, name in enumerate(listed))
    return DetectionSet(images, categories, tuple(detections))


def frame_of(path: Path) -> int:
    """The frame number at the end of a file's name, before its first dot: `000012.txt`, `drive_12.predictions.json`."""
    stem = path.name.split(".")[0]
    digits = stem[len(stem.rstrip("0123456789")) :]
    if not digits:
        raise DetectionError(
            f"{path}: its name ends in no frame number, expected such as 000012{''.join(path.suffixes)}"
        )
    return int(digits)


def files_in(folder: Path, suffix: str) -> list[Path]:
    """Files of a folder by frame; DetectionError if there are none."""
    if not folder.is_dir():
        raise DetectionError(f"{folder}: no such folder")
    found = sorted((p for p in folder.iterdir() if p.name.endswith(suffix)), key=frame_of)
    if not found:
        raise DetectionError(f"{folder}: holds no file that ends in {suffix}")
    return found


def loaded(path: Path) -> Any:  # any JSON  # noqa: ANN401 # any JSON
    """What a JSON file holds; DetectionError if it cannot be read."""
    try:
        return json.loads(path.read_bytes())
    except OSError as error:
        raise DetectionError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise DetectionError(f"{path}: is no JSON: {error}") from None


def lines_of(path: Path) -> list[tuple[str, list[str]]]:
    """The words of each line that is not empty, with its place."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise DetectionError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise DetectionError(f"{path}: is no text") from None
    return [(f"{path}:{i + 1}", line.split()) for i, line in enumerate(text.splitlines()) if line.strip()]


def numbers_of(words: Sequence[str], where: str) -> list[float]:
    """Words as finite numbers."""
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise DetectionError(f"{where}: {error}") from None
    if not np.isfinite(values).all():
        raise DetectionError(f"{where}: expected finite numbers")
    return values


def image_of(path: Path, frames: ImageFrames) -> Bytes:
    """A PNG as it is stored (16 bits stay 16); DetectionError if it cannot be read or has another size."""
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if picture is None:
        raise DetectionError(f"{path}: cannot be read as an image")
    if picture.shape != (frames.height, frames.width):
        raise DetectionError(f"{path}: has shape {picture.shape}, expected {(frames.height, frames.width)}")
    return np.asarray(picture)
