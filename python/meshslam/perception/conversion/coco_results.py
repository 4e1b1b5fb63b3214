"""COCO results (the list that detectors hand in for evaluation: image_id, category_id, segmentation, score)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from meshslam.errors import DetectionError
from meshslam.perception.coco import COCO_NUMBERS
from meshslam.perception.conversion.class_numbers import class_note
from meshslam.perception.conversion.frames import LARGEST_DIGITS, Found, ImageFrames, gathered
from meshslam.perception.detections import DetectionSet
from meshslam.perception.json_values import LARGEST_NUMBER, is_name, load_json, quoted
from meshslam.perception.masks import is_finite_number, segmentation_problem


def from_coco_results(path: Path, frames: ImageFrames, names: Mapping[int, str] | None = None) -> DetectionSet:
    """Read results; `image_id` is the frame number. `names` of `category_id`, COCO's own numbers (1 to 90) if None."""
    rows = load_json(path)
    if not isinstance(rows, list):
        hint = ", which is for `meshslam convert coco`" if isinstance(rows, dict) and "annotations" in rows else ""
        raise DetectionError(f"{path}: expected a list of results, found {type(rows).__name__}{hint}")
    own = _own_names(rows) if names is None else None
    table = own or (COCO_NUMBERS if names is None else names)
    found = [_found(row, f"{path}: [{i}]", frames, table) for i, row in enumerate(rows)]
    note = class_note(path, Counter(row["category_id"] for row in rows), table, given=names is not None or bool(own))
    return gathered(found, frames, notes=note)


def counted_from_one(path: Path, names: Mapping[int, str]) -> dict[int, str]:
    """Names by `category_id` for names counted from 0: results count categories from 1, unless one of them is 0."""
    if 0 not in names:
        return dict(names)
    rows = load_json(path)
    ids = [row.get("category_id") for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []
    return dict(names) if 0 in ids else {number + 1: name for number, name in names.items()}


def _own_names(rows: list[object]) -> dict[int, str]:
    """Names by `category_id` where every result has its `category_name`, as sahi's have; empty otherwise."""
    pairs = {(r.get("category_id"), r.get("category_name")) for r in rows if isinstance(r, dict) and _is_named(r)}
    whole = all(isinstance(r, dict) and _is_named(r) for r in rows)
    return {n: str(name) for n, name in pairs if type(n) is int} if whole else {}


def _is_named(row: dict[str, object]) -> bool:
    name = row.get("category_name")
    return is_name(name) and bool(name) and type(row.get("category_id")) is int


def _found(row: object, where: str, frames: ImageFrames, names: Mapping[int, str]) -> Found:
    if not isinstance(row, dict):
        raise DetectionError(f"{where}: expected an object")
    frame, category, score = row.get("image_id"), row.get("category_id"), row.get("score")
    if isinstance(frame, str):  # a file's name, of which Ultralytics makes a number where it is one
        digits = re.search(rf"\d{{1,{LARGEST_DIGITS}}}$", frame.split(".")[0], re.ASCII)
        frame = frame if digits is None else int(digits[0])
    if type(frame) is not int:
        raise DetectionError(f"{where}: image_id: found {quoted(frame)}, expected a frame number")
    if type(category) is not int or category not in names:
        known = ", ".join(map(str, sorted(names)[:5]))
        raise DetectionError(f"{where}: category_id: found {quoted(category)}, expected one of {known} ...")
    if not is_finite_number(score) or not 0 <= score <= 1:
        raise DetectionError(f"{where}: score: found {quoted(score)}, expected a number from 0 to 1")
    segmentation = row.get("segmentation")
    problem = segmentation_problem(segmentation, frames.height, frames.width)
    if problem:
        raise DetectionError(f"{where}: segmentation: {problem} (boxes alone are not enough)")
    track = row.get("track_id")  # TAO's results have it
    if track is not None and (type(track) is not int or abs(track) >= LARGEST_NUMBER):
        raise DetectionError(f"{where}: track_id: found {quoted(track)}, expected an integer")
    number = track if track is not None and track >= 0 else None
    return Found(frames.known(frame, where), names[category], float(score), segmentation, number)  # type: ignore[arg-type] # checked
