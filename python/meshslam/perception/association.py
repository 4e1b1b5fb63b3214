"""Which detection of the next frame shows which object (paper, Sec. IV-A)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, best_pairs
from meshslam.perception.flow import Flow
from meshslam.perception.tracked_mask import TrackedMask, mask_iou

FEW_POINTS = 5.0  # with as many followed points, flow and overlap of masks count alike


@dataclass(frozen=True, eq=False)
class Followed:
    """A mask in one frame, and where its corners and key points are in the other."""

    tracked: TrackedMask
    points: Flow
    keypoints: Flow


@dataclass(frozen=True, eq=False)
class Expected:
    """An object of the last frame: followed into this one, and the mask expected there."""

    followed: Followed
    predicted: TrackedMask


def paper_score(object_: Followed, detection: Followed) -> float:
    """Compute M_lm (paper, Sec. IV-A): key points that flow into each other's masks, weighted by their confidence.

    Without key points, corners take their place: those that land in the detection's mask and return to the object's.
    """
    if len(object_.tracked.keypoints) and len(object_.tracked.keypoints) == len(detection.tracked.keypoints):
        return _keypoints(object_, detection)[0]
    return _corners(object_, detection)[0]


def affinity(object_: Expected, detection: Followed) -> float:
    """Say how well a detection continues an object, in [0, 1].

    The share of points, followed both ways, that land in the other's mask; the fewer points there are, the more counts
    the overlap of the detection's mask with the predicted one.
    """
    keypoints, all_keypoints = _keypoints(object_.followed, detection)
    ahead, all_ahead = _corners(object_.followed, detection)
    behind, all_behind = _corners(detection, object_.followed)
    overlap = mask_iou(object_.predicted, detection.tracked)
    count = min(all_ahead, all_behind) + all_keypoints
    if count == 0:
        return overlap
    share_ahead = (ahead + keypoints) / (all_ahead + all_keypoints)
    share_behind = (behind + keypoints) / (all_behind + all_keypoints)
    trust = 0.8 * count / (count + FEW_POINTS)
    return float(trust * np.sqrt(share_ahead * share_behind) + (1 - trust) * overlap)


def _keypoints(one: Followed, other: Followed) -> tuple[float, float]:
    """Sum up the confidence of the key points that land in each other's masks, and of all that both know."""
    if len(one.tracked.keypoints) != len(other.tracked.keypoints) or len(one.tracked.keypoints) == 0:
        return 0.0, 0.0
    weights = np.where(other.tracked.weights > 0, one.tracked.weights, 0.0)
    there = other.tracked.contains(one.keypoints.points)
    back = one.tracked.contains(other.keypoints.points)
    return float(weights[there & back].sum()), float(weights.sum())


def _corners(one: Followed, other: Followed) -> tuple[float, float]:
    """Count the corners of one that land in the other's mask and return, and all that could be followed."""
    landed = other.tracked.contains(one.points.points) & one.tracked.contains(one.points.returned) & one.points.good
    return float(landed.sum()), float(one.points.good.sum())


def size_ratio(one: TrackedMask, other: TrackedMask) -> float:
    """Return by how much widths or heights differ, at least 1; a side that the image's border cuts is not compared."""
    height, width = one.image_size
    ratio = 1.0
    for axis, length in ((0, width), (1, height)):
        cut = any(s.box[axis] <= 1 or s.box[axis + 2] >= length - 1 for s in (one, other))
        small, large = sorted(float(s.box[axis + 2] - s.box[axis]) for s in (one, other))
        ratio = ratio if cut else max(ratio, large / small)
    return ratio


def assign(scores: Floats, minimum: float) -> list[tuple[int, int]]:
    """Find one-to-one pairs (row, column) of the largest total score, none below `minimum` (Hungarian method)."""
    gain = np.where(scores >= minimum, scores, 0.0)
    return [pair for pair in best_pairs(gain) if gain[pair] > 0]


def assign_greedily(scores: Floats) -> list[tuple[int, int]]:
    """Give every row its best column (paper: argmax over m); of several rows that want one, the best gets it."""
    best = [(float(row.max()), r, int(row.argmax())) for r, row in enumerate(scores) if row.size and row.max() > 0]
    taken: dict[int, int] = {}
    for _, row, column in sorted(best, key=lambda b: (-b[0], b[1])):
        taken.setdefault(column, row)
    return sorted((row, column) for column, row in taken.items())
