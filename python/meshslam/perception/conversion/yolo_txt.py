"""The text files of YOLO's segmentation (`save_txt save_conf`, also of tracking): one an image, a line an instance."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.errors import DetectionError
from meshslam.perception.coco import COCO_CLASSES
from meshslam.perception.conversion.class_numbers import class_note
from meshslam.perception.conversion.frames import Found, ImageFrames, files_in, frame_of, gathered, lines_of, numbers_of
from meshslam.perception.detections import DetectionSet
from meshslam.perception.json_values import LARGEST_NUMBER

_ID = re.compile(r"[1-9]\d{0,15}", re.ASCII)  # as trackers write it: no dot, from 1 on
_BORDER = 0.99  # share of the image's height from which on a point may be at its lower border


@dataclass(frozen=True)
class _Line:
    """One instance as it stands in a file."""

    where: str
    frame: int
    words: tuple[str, ...]

    @property
    def has_pairs(self) -> bool:
        """Whether a class and pairs of numbers are all: a polygon alone, or one with confidence and track."""
        return len(self.words) % 2 == 1

    @property
    def ends_in_id(self) -> bool:
        """Whether the last word may be a track's number."""
        return _ID.fullmatch(self.words[-1]) is not None


@dataclass(frozen=True)
class _Kinds:
    """What the last words of lines are, decided over all files: one line alone does not tell."""

    pairs_have_track: bool  # class, polygon, confidence, track
    last_is_track: bool  # class, polygon, track; otherwise class, polygon, confidence


def from_yolo_txt(
    folder: Path, frames: ImageFrames, names: Sequence[str] | Mapping[int, str] | None = None
) -> DetectionSet:
    """Read `class x1 y1 x2 y2 ... [score] [track]` with coordinates as shares of the image's size.

    Without a score it is 1. `names` are those of the class numbers, COCO's if None. A file's name ends in its frame
    number. DetectionError names file and line.
    """
    table = dict(enumerate(COCO_CLASSES)) if names is None else _table(names)
    lines = []
    for path in files_in(folder, ".txt"):
        frame = frames.known(frame_of(path), str(path))
        lines += [_Line(where, frame, tuple(words)) for where, words in lines_of(path)]
    kinds = _Kinds(_pairs_have_track(lines), _last_is_track(lines))
    found = [_found(line, kinds, frames, table) for line in lines]
    notes = class_note(folder, Counter(int(float(line.words[0])) for line in lines), table, given=names is not None)
    tracks = {f.track_id for f in found} - {None}
    if tracks:
        notes += (f"{folder}: the last numbers of lines are read as track ids ({len(tracks)} differ)",)
    return gathered(found, frames, notes=notes)


def _table(names: Sequence[str] | Mapping[int, str]) -> dict[int, str]:
    return dict(names) if isinstance(names, Mapping) else dict(enumerate(names))


def _pairs_have_track(lines: Sequence[_Line]) -> bool:
    """Whether lines of a class and pairs end in confidence and track.

    Every such line then ends in an integer. A polygon may end so too, in a point at the image's lower border: but then
    another of its points is likely there.
    """
    ends = [line for line in lines if line.has_pairs and len(line.words) >= 7]
    return bool(ends) and all(line.ends_in_id for line in ends) and any(_cannot_be_point(line) for line in ends)


def _cannot_be_point(line: _Line) -> bool:
    heights = numbers_of(line.words[2:-1:2], line.where)
    return line.words[-1] != "1" or max(heights) < _BORDER


def _last_is_track(lines: Sequence[_Line]) -> bool:
    """Whether lines with one number behind their pairs end in a track: integers, which one frame has once each."""
    ends = [line for line in lines if not line.has_pairs]
    if not ends or not all(line.ends_in_id for line in ends):
        return False
    counts = Counter((line.frame, line.words[-1]) for line in ends)
    return any(line.words[-1] != "1" for line in ends) or max(counts.values()) == 1


def _found(line: _Line, kinds: _Kinds, frames: ImageFrames, names: Mapping[int, str]) -> Found:
    where, values = line.where, numbers_of(line.words, line.where)
    if len(values) < 5:
        raise DetectionError(f"{where}: found {len(values)} numbers, expected a class and at least three points")
    track = score = None
    if kinds.pairs_have_track if line.has_pairs else kinds.last_is_track:
        track = _track(values.pop(), where)
    if len(values) % 2 == 0:
        score = values.pop()
    if len(values) == 5:
        raise DetectionError(f"{where}: a box, no masks: expected a class and a polygon (of a network that segments)")
    if len(values) < 7:
        raise DetectionError(f"{where}: found {len(line.words)} numbers, expected a class and at least three points")
    index = values[0]
    if index != int(index) or int(index) not in names:
        known = ", ".join(map(str, sorted(names)[:3]))
        raise DetectionError(f"{where}: class {index:g}: expected one of {known} ... (--names gives names)")
    points = np.array(values[1:]).reshape(-1, 2)
    if points.min() < -0.01 or points.max() > 1.01 or not 0 <= (1.0 if score is None else score) <= 1:
        raise DetectionError(f"{where}: coordinates and score must lie between 0 and 1")
    polygon = (np.clip(points, 0, 1) * [frames.width, frames.height]).ravel().tolist()
    return Found(line.frame, names[int(index)], 1.0 if score is None else score, [polygon], track)


def _track(value: float, where: str) -> int:
    if value > LARGEST_NUMBER:
        raise DetectionError(f"{where}: track {value:g}: expected an integer of at most 2^53")
    return int(value)
