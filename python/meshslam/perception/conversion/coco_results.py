"""COCO results (the list that detectors hand in for evaluation: image_id, category_id, segmentation, score)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from meshslam.errors import DetectionError
from meshslam.perception.coco import COCO_NUMBERS
from meshslam.perception.conversion.frames import Found, ImageFrames, gathered, loaded
from meshslam.perception.detections import DetectionSet
from meshslam.perception.masks import is_finite_number, segmentation_problem


def from_coco_results(path: Path, frames: ImageFrames, names: Mapping[int, str] | None = None) -> DetectionSet:
    """Read results; `image_id` is the frame number. `names` of `category_id`, COCO's own numbers (1 to 90) if None."""
    names = COCO_NUMBERS if names is None else names
    rows = loaded(path)
    if not isinstance(rows, list):
        raise DetectionError(f"{path}: expected a list of results, found {type(rows).__name__}")
    return gathered([_found(row, f"{path}: [{i}]", frames, names) for i, row in enumerate(rows)], frames)


def _found(row: object, where: str, frames: ImageFrames, names: Mapping[int, str]) -> Found:
    if not isinstance(row, dict):
        raise DetectionError(f"{where}: expected an object")
    frame, category, score = row.get("image_id"), row.get("category_id"), row.get("score")
    if type(frame) is not int:
        raise DetectionError(f"{where}: image_id: found {frame!r}, expected a frame number")
    if type(category) is not int or category not in names:
        raise DetectionError(f"{where}: category_id: found {category!r}, expected one of {sorted(names)[:5]} ...")
    if not is_finite_number(score) or not 0 <= score <= 1:
        raise DetectionError(f"{where}: score: found {score!r}, expected a number from 0 to 1")
    segmentation = row.get("segmentation")
    problem = segmentation_problem(segmentation, frames.height, frames.width)
    if problem:
        raise DetectionError(f"{where}: segmentation: {problem} (boxes alone are not enough)")
    return Found(frames.known(frame, where), names[category], float(score), segmentation)  # type: ignore[arg-type] # checked
