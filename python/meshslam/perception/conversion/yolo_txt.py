"""The text files of YOLO's segmentation (`save_txt save_conf`): one an image, a line an instance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from meshslam.errors import DetectionError
from meshslam.perception.coco import COCO_CLASSES
from meshslam.perception.conversion.frames import Found, ImageFrames, files_in, frame_of, gathered, lines_of, numbers_of
from meshslam.perception.detections import DetectionSet


def from_yolo_txt(folder: Path, frames: ImageFrames, names: Sequence[str] = COCO_CLASSES) -> DetectionSet:
    """Read `class x1 y1 x2 y2 ... [score]` with coordinates as shares of the image's size; without a score it is 1.

    A file's name ends in its frame number. DetectionError names file and line.
    """
    found = []
    for path in files_in(folder, ".txt"):
        frame = frames.known(frame_of(path), str(path))
        found += [_found(words, where, frame, frames, names) for where, words in lines_of(path)]
    return gathered(found, frames)


def _found(words: list[str], where: str, frame: int, frames: ImageFrames, names: Sequence[str]) -> Found:
    values = numbers_of(words, where)
    if len(values) < 7:
        raise DetectionError(f"{where}: found {len(values)} numbers, expected a class and at least three points")
    index, score = values[0], values.pop() if len(values) % 2 == 0 else 1.0
    if index != int(index) or not 0 <= index < len(names):
        raise DetectionError(f"{where}: class {words[0]}: expected 0 to {len(names) - 1}")
    points = np.array(values[1:]).reshape(-1, 2)
    if points.min() < -0.01 or points.max() > 1.01 or not 0 <= score <= 1:
        raise DetectionError(f"{where}: coordinates and score must lie between 0 and 1")
    polygon = (np.clip(points, 0, 1) * [frames.width, frames.height]).ravel().tolist()
    return Found(frame, names[int(index)], score, [polygon])
