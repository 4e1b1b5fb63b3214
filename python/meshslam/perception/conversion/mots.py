"""MOTS (Voigtlaender et al. 2019): instance masks with track ids, as text or as 16-bit pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshslam.errors import DetectionError
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


def from_mots_txt(path: Path, frames: ImageFrames) -> DetectionSet:
    """Read `frame id class height width rle`: id is the track's (negative: none); regions to ignore are left out."""
    return gathered([f for where, words in lines_of(path) if (f := _line(words, where, frames))], frames)


def _line(words: list[str], where: str, frames: ImageFrames) -> Found | None:
    if len(words) != 6:
        raise DetectionError(
            f"{where}: found {len(words)} words, expected frame, id, class, height, width, run lengths"
        )
    frame, number, kind, height, width = integers_of(words[:5], where)
    if kind == IGNORED:
        return None
    code: RunLengths = {"size": [height, width], "counts": words[5]}
    problem = segmentation_problem(code, frames.height, frames.width)
    if problem:
        raise DetectionError(f"{where}: the mask {problem}")
    return Found(frames.known(frame, where), _name(kind, where), 1.0, code, number if number >= 0 else None)


def from_mots_png(folder: Path, frames: ImageFrames) -> DetectionSet:
    """Read pictures of 16 bits, a file a frame, whose values are 1000 x class + track."""
    found = []
    for path in files_in(folder, ".png"):
        frame, values = frames.known(frame_of(path), str(path)), image_of(path, frames)
        for number in np.unique(values[values > 0]).tolist():
            if number // PER_CLASS != IGNORED:
                code = encode_mask((values == number).astype(np.uint8))
                found.append(Found(frame, _name(number // PER_CLASS, str(path)), 1.0, code, number))
    return gathered(found, frames)


def _name(kind: int, where: str) -> str:
    if kind not in NAMES:
        raise DetectionError(f"{where}: class {kind}: MOTS has {NAMES}, and {IGNORED} for what is ignored")
    return NAMES[kind]
