"""MOTS (Voigtlaender et al. 2019): instance masks with track ids, as text or as 16-bit pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from meshslam.errors import DetectionError
from meshslam.perception.conversion.class_numbers import class_note
from meshslam.perception.conversion.frames import (
    Found,
    ImageFrames,
    files_in,
    frame_of,
    gathered,
    image_of,
    integers_of,
    lines_of,
)
from meshslam.perception.detections import DetectionSet
from meshslam.perception.masks import RunLengths, encode_mask, segmentation_problem

NAMES = {1: "car", 2: "person"}
PER_CLASS = 1000  # an instance's number is its class times this, plus the number of its track
IGNORED = 10  # class of regions that are not judged


def from_mots_txt(path: Path, frames: ImageFrames, names: Mapping[int, str] | None = None) -> DetectionSet:
    """Read `frame id class height width rle`: id is the track's (negative: none); regions to ignore are left out.

    `names` of the classes, 1 car and 2 person if None; names counted from 0 are MOTS' classes from 1, unless one is 0.
    """
    lines = [(where, words, _integers(words, where)) for where, words in lines_of(path)]
    table = _table(names, {row[2] for _, _, row in lines})
    found = [f for where, words, row in lines if (f := _line(words, row, where, frames, table))]
    return gathered(found, frames, notes=_note(path, [row[2] for _, _, row in lines], table, names))


def _integers(words: list[str], where: str) -> list[int]:
    if len(words) != 6:
        raise DetectionError(
            f"{where}: found {len(words)} words, expected frame, id, class, height, width, run lengths"
        )
    return integers_of(words[:5], where)


def _line(words: list[str], row: list[int], where: str, frames: ImageFrames, table: Mapping[int, str]) -> Found | None:
    frame, number, kind, height, width = row
    if kind == IGNORED and kind not in table:
        return None
    code: RunLengths = {"size": [height, width], "counts": words[5]}
    problem = segmentation_problem(code, frames.height, frames.width)
    if problem:
        raise DetectionError(f"{where}: the mask {problem}")
    return Found(frames.known(frame, where), _name(kind, where, table), 1.0, code, number if number >= 0 else None)


def from_mots_png(folder: Path, frames: ImageFrames, names: Mapping[int, str] | None = None) -> DetectionSet:
    """Read pictures of 16 bits, a file a frame, whose values are 1000 x class + track; `names` as for the text."""
    table = _table(names, ())
    found, kinds = [], []
    for path in files_in(folder, ".png"):
        frame, values = frames.known(frame_of(path), str(path)), image_of(path, frames)
        for number in np.unique(values[values > 0]).tolist():
            kind = number // PER_CLASS
            if kind == IGNORED and kind not in table:
                continue
            code = encode_mask((values == number).astype(np.uint8))
            found.append(Found(frame, _name(kind, str(path), table), 1.0, code, number))
            kinds.append(kind)
    return gathered(found, frames, notes=_note(folder, kinds, table, names))


def _table(names: Mapping[int, str] | None, used: Collection[int]) -> Mapping[int, str]:
    """Names by MOTS' class numbers, which begin with 1."""
    if names is None:
        return NAMES
    return names if 0 not in names or 0 in used else {number + 1: name for number, name in names.items()}


def _note(path: Path, kinds: list[int], table: Mapping[int, str], names: Mapping[int, str] | None) -> tuple[str, ...]:
    """Which names were taken, where they were given; MOTS' own need no word."""
    return () if names is None else class_note(path, Counter(k for k in kinds if k in table), table, given=True)


def _name(kind: int, where: str, table: Mapping[int, str]) -> str:
    if kind not in table:
        known = ", ".join(f"{number} {name}" for number, name in sorted(table.items())[:5])
        ignored = "" if IGNORED in table else f", and {IGNORED} is ignored"
        raise DetectionError(f"{where}: class {kind}: the names are {known}{ignored}: --names says others")
    return table[kind]
