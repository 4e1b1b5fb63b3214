"""Key points by OpenPifPaf (Kreiss et al. 2021): its files have no masks, so that they go to detections that have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from meshslam.errors import DetectionError
from meshslam.geometry import Floats, best_pairs
from meshslam.perception.coco import VEHICLES
from meshslam.perception.conversion.frames import files_in, frame_of
from meshslam.perception.detections import Detection, DetectionSet
from meshslam.perception.json_values import load_json
from meshslam.perception.keypoint_names import APOLLO_24, APOLLO_FROM_OURS
from meshslam.perception.masks import is_finite_number

_ORDER = [APOLLO_24.index(name) for name in APOLLO_FROM_OURS.values()]
LEAST_OVERLAP = 0.3  # IoU of the boxes


def with_openpifpaf(folder: Path, detections: DetectionSet, shift: int = 0) -> DetectionSet:
    """Give vehicles the key points of `*.predictions.json` (one an image, 24 key points of ApolloCar3D).

    An annotation goes to the detection of its frame whose box overlaps it, one to one. A key point's score is its
    confidence, 0 where it was not found. `shift` is added to the frame numbers of the files' names.
    """
    by_frame = detections.by_frame()
    filled: dict[int, Detection] = {}
    for path in files_in(folder, ".json"):
        cars = [d for d in by_frame.get(frame_of(path) + shift, ()) if d.category in VEHICLES]
        points = _annotations(path)
        overlap = np.array([[_overlap(d.bbox, _box(p)) for p in points] for d in cars]).reshape(len(cars), len(points))
        for row, column in best_pairs(overlap):
            if overlap[row, column] >= LEAST_OVERLAP:
                filled[cars[row].id] = _with(cars[row], points[column][_ORDER])
    names = tuple(APOLLO_FROM_OURS)
    categories = tuple(replace(c, keypoints=names) if c.name in VEHICLES else c for c in detections.categories)
    plain = (_without_points(d) if d.category in VEHICLES else d for d in detections.detections)
    return replace(detections, categories=categories, detections=tuple(filled.get(d.id, d) for d in plain))


def _annotations(path: Path) -> list[Floats]:
    """Key points (24, 3) with x, y, confidence of each annotation that has any."""
    rows = load_json(path)
    rows = rows.get("predictions") if isinstance(rows, dict) else rows
    if not isinstance(rows, list):
        raise DetectionError(f"{path}: expected a list of annotations")
    found = []
    for i, row in enumerate(rows):
        flat = row.get("keypoints") if isinstance(row, dict) else None
        numbers = isinstance(flat, list) and all(is_finite_number(v) or v != v for v in flat)
        if not numbers or flat is None or len(flat) != 3 * len(APOLLO_24):
            raise DetectionError(f"{path}: [{i}]: keypoints: expected x, y, confidence of {len(APOLLO_24)} key points")
        points = np.array(flat, float).reshape(-1, 3)
        if np.isfinite(points).all() and (points[:, 2] > 0).any():
            found.append(points)
    return found


def _box(points: Floats) -> tuple[float, float, float, float]:
    shown = points[points[:, 2] > 0, :2]
    (x0, y0), (x1, y1) = shown.min(0), shown.max(0)
    return float(x0), float(y0), float(x1 - x0), float(y1 - y0)


def _overlap(one: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> float:
    """Intersection over union of boxes x, y, width, height."""
    w = min(one[0] + one[2], other[0] + other[2]) - max(one[0], other[0])
    h = min(one[1] + one[3], other[1] + other[3]) - max(one[1], other[1])
    shared = max(0.0, w) * max(0.0, h)
    return shared / max(1e-9, one[2] * one[3] + other[2] * other[3] - shared)


def _without_points(detection: Detection) -> Detection:
    return replace(detection, keypoints=None, keypoint_scores=None, keypoint_sigmas_px=None, viewing_angle_shares=None)


def _with(detection: Detection, points: Floats) -> Detection:
    height, width = detection.image_size
    inside = np.all((points[:, :2] >= -0.5) & (points[:, :2] <= [width - 0.5, height - 0.5]), axis=1)
    scores = np.where(inside, np.clip(points[:, 2], 0, 1), 0.0)
    pixels = np.where((scores > 0)[:, None], points[:, :2], 0.0)
    return replace(_without_points(detection), keypoints=pixels, keypoint_scores=scores)
