"""What the converters know of the recording, and how they put detections together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from meshslam.errors import DetectionError
from meshslam.geometry import Bytes
from meshslam.perception.detections import CategoryEntry, Detection, DetectionSet, ImageEntry
from meshslam.perception.json_values import LARGEST_NUMBER, quoted
from meshslam.perception.masks import Segmentation, decode_segmentation

LARGEST_DIGITS = 18  # of a frame number in a file's name


@dataclass(frozen=True)
class ImageFrames:
    """Frame numbers of a recording and the size of its images, px."""

    numbers: tuple[int, ...]
    width: int
    height: int
    first: int | None = None  # number that other tools give to the recording's first frame; None: its own

    def known(self, number: int, where: str) -> int:
        """The frame that another tool's number means; DetectionError if there is none."""
        frame = number + self.shift
        if frame in self._every:
            return frame
        span = f"{self.numbers[0]} to {self.numbers[-1]}" if self.numbers else "none"
        counted = "" if self.first is None else f", counted here from {self.first}"
        ahead = bool(self.numbers) and self.first is None and number == self.numbers[-1] + 1
        hint = f" (if numbers begin with {self.numbers[0] + 1}: --first-frame {self.numbers[0] + 1})" if ahead else ""
        raise DetectionError(f"{where}: frame {quoted(number)}: the recording's frames are {span}{counted}{hint}")

    @property
    def shift(self) -> int:
        """What is added to another tool's number."""
        return 0 if self.first is None or not self.numbers else self.numbers[0] - self.first

    @cached_property
    def _every(self) -> frozenset[int]:
        return frozenset(self.numbers)


@dataclass(frozen=True, eq=False)
class Found:
    """One detection on its way in."""

    frame: int
    category: str
    score: float
    segmentation: Segmentation
    track_id: int | None = None


def gathered(
    found: Iterable[Found], frames: ImageFrames, names: Sequence[str] = (), notes: Sequence[str] = ()
) -> DetectionSet:
    """A set with ids in the order of the frames; empty masks are left out. `names` come first among the categories.

    `notes` become its warnings, with one more where the frames' numbers seem to begin one too high.
    """
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
    said = [*notes, *_numbering_note({row.frame for row in rows}, frames)]
    return DetectionSet(images, categories, tuple(detections), tuple(said))


def _numbering_note(used: set[int], frames: ImageFrames) -> list[str]:
    """A note where the first frame alone has nothing: other tools count from 1."""
    if frames.first is not None or len(used) < 2 or len(frames.numbers) < 2:
        return []
    first, second = frames.numbers[:2]
    if min(used) != second or len(used) != len([n for n in frames.numbers if second <= n <= max(used)]):
        return []
    return [
        f"frame {first} has no detection, but frames {second} to {max(used)} all have: if the numbers begin with "
        f"{first + 1}, say --first-frame {first + 1}"
    ]


def frame_of(path: Path) -> int:
    """The frame number at the end of a file's name, before its first dot: `000012.txt`, `drive_12.predictions.json`."""
    stem = path.name.split(".")[0]
    digits = stem[len(stem.rstrip("0123456789")) :]
    if not digits:
        raise DetectionError(
            f"{path}: its name ends in no frame number, expected such as 000012{''.join(path.suffixes)}"
        )
    if len(digits) > LARGEST_DIGITS:
        raise DetectionError(f"{path}: its name ends in {len(digits)} digits, expected at most {LARGEST_DIGITS}")
    return int(digits)


def files_in(folder: Path, suffix: str) -> list[Path]:
    """Files of a folder by frame; DetectionError if there are none."""
    if not folder.is_dir():
        raise DetectionError(f"{folder}: no such folder")
    found = sorted((p for p in folder.iterdir() if p.name.endswith(suffix)), key=frame_of)
    if not found:
        raise DetectionError(f"{folder}: holds no file that ends in {suffix}")
    return found


def lines_of(path: Path) -> list[tuple[str, list[str]]]:
    """The words of each line that is not empty, with its place."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise DetectionError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise DetectionError(f"{path}: is no text") from None
    return [(f"{path}:{i + 1}", line.split()) for i, line in enumerate(text.splitlines()) if line.strip()]


def numbers_of(words: Sequence[str], where: str) -> list[float]:
    """Words as finite numbers."""
    try:
        values = [float(word) for word in words]
    except ValueError:
        wrong = next(word for word in words if not _is_number(word))
        raise DetectionError(f"{where}: found {quoted(wrong)}, expected a number") from None
    if not np.isfinite(values).all():
        raise DetectionError(f"{where}: expected finite numbers")
    return values


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def integers_of(words: Sequence[str], where: str) -> list[int]:
    """Words as integers of at most 2^53 in size; such as 3.0 are integers too."""
    values = numbers_of(words, where)
    for word, value in zip(words, values, strict=True):
        if value != int(value) or abs(value) > LARGEST_NUMBER:
            raise DetectionError(f"{where}: found {quoted(word)}, expected an integer of at most 2^53")
    return [int(value) for value in values]


def image_of(path: Path, frames: ImageFrames) -> Bytes:
    """A PNG as it is stored (16 bits stay 16); DetectionError if it cannot be read or has another size."""
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if picture is None:
        raise DetectionError(f"{path}: cannot be read as an image")
    if picture.shape != (frames.height, frames.width):
        raise DetectionError(f"{path}: has shape {picture.shape}, expected {(frames.height, frames.width)}")
    return np.asarray(picture)
