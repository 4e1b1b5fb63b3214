"""Several answers for one object become one: by boxes, by masks, and within a mask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from meshslam.geometry import AnyArray, Bools, Bytes, Floats, Ints, Singles

Indices = NDArray[np.int32]

SPECK_SHARE = 0.1  # of the largest part's area: smaller parts are noise
HOLE_SHARE = 0.02  # likewise for holes


def box_iou(boxes: Floats, others: Floats) -> Floats:
    """Intersection over union (N, M) of boxes (N, 4) and (M, 4), x0, y0, x1, y1; 0 where both are empty."""
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(2)
    areas, other_areas = (np.clip(b[:, 2:] - b[:, :2], 0, None).prod(1) for b in (boxes, others))
    union = areas[:, None] + other_areas[None] - shared
    iou: Floats = np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)
    return iou


def suppress_boxes(boxes: Floats, scores: Floats, groups: AnyArray, iou_threshold: float) -> Ints:
    """Keep the best of the boxes (N, 4) of one group that overlap by more than `iou_threshold`.

    Returns indices by falling score; ties go to the earlier box.
    """
    order = np.argsort(-scores, kind="stable")
    kept: list[int] = []
    while len(order):
        best, rest = order[0], order[1:]
        kept.append(int(best))
        twin = (box_iou(boxes[[best]], boxes[rest])[0] > iou_threshold) & (groups[rest] == groups[best])
        order = rest[~twin]
    return np.array(kept, np.int64)


@dataclass(frozen=True, eq=False)
class Patch:
    """Mask logits of one object in a rectangle of the image; outside of it the object is not."""

    left: int
    top: int
    logits: Singles  # (height, width)

    @property
    def inside(self) -> Bools:
        """Where the object is."""
        found: Bools = self.logits > 0
        return found

    @property
    def place(self) -> tuple[slice, slice]:
        """Rows and columns of the image."""
        rows, columns = self.logits.shape
        return slice(self.top, self.top + rows), slice(self.left, self.left + columns)


def shared_area_px(one: Patch, other: Patch) -> int:
    """Count the pixels where both objects are."""
    top, left = max(one.top, other.top), max(one.left, other.left)
    bottom, right = (min(one.place[i].stop, other.place[i].stop) for i in (0, 1))
    if bottom <= top or right <= left:
        return 0
    parts = [p.inside[top - p.top : bottom - p.top, left - p.left : right - p.left] for p in (one, other)]
    return int((parts[0] & parts[1]).sum())


def suppress_nested(patches: Sequence[Patch], groups: AnyArray, share: float) -> list[int]:
    """Choose of masks, given by falling score, those of which less than `share` of the smaller lies in a chosen one.

    Only masks of one group compete. Returns indices.
    """
    kept: list[int] = []
    areas = [int(p.inside.sum()) for p in patches]
    for i, patch in enumerate(patches):
        rivals = [k for k in kept if groups[k] == groups[i]]
        if areas[i] and all(shared_area_px(patch, patches[k]) < share * min(areas[i], areas[k]) for k in rivals):
            kept.append(i)
    return kept


def owners(patches: Sequence[Patch], height: int, width: int) -> Indices:
    """Find whose each pixel is, (height, width): of the patch with the largest positive logit; -1 if of none."""
    owner = np.full((height, width), -1, np.int32)
    best = np.zeros((height, width), np.float32)
    for i, patch in enumerate(patches):
        better = patch.logits > best[patch.place]
        owner[patch.place][better] = i
        best[patch.place][better] = patch.logits[better]
    return owner


def share_out(patches: Sequence[Patch], solid: Sequence[bool], height: int, width: int) -> list[Bytes]:
    """Cut clean masks in the patches' rectangles; no pixel is in two.

    `solid` objects have no holes but where another object is; others keep all but the smallest.
    """
    owner = owners(patches, height, width)
    masks: list[Bytes] = []
    for i, patch in enumerate(patches):
        part = owner[patch.place]
        mask = clean_mask((part == i).astype(np.uint8), hole_share=np.inf if solid[i] else HOLE_SHARE)
        mask[(part >= 0) & (part != i)] = 0
        part[mask > 0] = i
        masks.append(mask)
    return masks


def outline_filled(mask: Bytes) -> Bytes:
    """Return the mask with everything that its parts enclose."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(cv2.drawContours(np.zeros_like(mask), contours, -1, 1, cv2.FILLED), np.uint8)


def clean_mask(mask: Bytes, speck_share: float = SPECK_SHARE, hole_share: float = HOLE_SHARE) -> Bytes:
    """Drop parts and fill holes that are small against the largest part.

    Larger parts stay: an occluder splits a car. A background region at the array's border is no hole.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count < 2:
        return mask
    areas = stats[:, cv2.CC_STAT_AREA]
    largest = areas[1:].max()
    keep = areas >= speck_share * largest
    keep[0] = False
    cleaned = keep[labels].astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(1 - cleaned, connectivity=4)
    left, top, width, height, area = stats.T[:5]
    inner = (left > 0) & (top > 0) & (left + width < mask.shape[1]) & (top + height < mask.shape[0])
    fill = inner & (area <= hole_share * largest)
    fill[0] = False
    filled: Bytes = cleaned | fill[labels].astype(np.uint8)
    return filled
