"""What the tracker knows of an object in one frame: seen, or predicted where it was missed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from meshslam.geometry import Bools, Bytes, Floats
from meshslam.perception.coco import association_group
from meshslam.perception.detections import Detection
from meshslam.perception.flow import corners

NO_POINTS = np.zeros((0, 2))


@dataclass(frozen=True, eq=False)
class TrackedMask:
    """An object's mask, cut out of its image, and the points by which it is followed."""

    group: str  # of categories that may be one object
    left: int  # of the cut-out, px; may lie outside the image where it is predicted
    top: int
    mask: Bytes  # (h, w), zeros and ones
    image_size: tuple[int, int]  # height, width
    points: Floats  # (N, 2) corners, px
    keypoints: Floats  # (K, 2) px; K = 0 where there are none
    weights: Floats  # (K,) confidence of each key point, 0: no information

    @cached_property
    def box(self) -> Floats:
        """x0, y0, x1, y1 of the cut-out."""
        height, width = self.mask.shape
        return np.array([self.left, self.top, self.left + width, self.top + height], float)

    def contains(self, points: Floats) -> Bools:
        """Tell which points (N, 2) fall on the mask."""
        x = np.floor(points[:, 0] + 0.5).astype(int) - self.left
        y = np.floor(points[:, 1] + 0.5).astype(int) - self.top
        height, width = self.mask.shape
        found: Bools = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        if found.any():  # far from most masks
            found[found] = self.mask[y[found], x[found]] > 0
        return found

    def moved(self, box: Floats) -> TrackedMask:
        """Return the mask stretched to another box, without points."""
        x0, y0, x1, y1 = np.round(box).astype(int).tolist()
        width, height = max(1, x1 - x0), max(1, y1 - y0)
        mask = np.asarray(cv2.resize(self.mask, (width, height), interpolation=cv2.INTER_NEAREST), np.uint8)
        return TrackedMask(self.group, x0, y0, mask, self.image_size, NO_POINTS, NO_POINTS, np.zeros(0))


def tracked_mask(detection: Detection, image: Bytes | None, corner_count: int) -> TrackedMask | None:
    """Cut a detection out of its (grey) image; None if its mask is empty."""
    whole = detection.mask()
    left, top, width, height = cv2.boundingRect(whole)
    if width == 0 or height == 0:
        return None
    mask = np.ascontiguousarray(whole[top : top + height, left : left + width])
    fits = image is not None and image.shape == detection.image_size
    points = corners(image, mask, left, top, corner_count) if image is not None and fits else NO_POINTS
    known = detection.keypoints is not None and detection.keypoint_scores is not None
    keypoints = detection.keypoints if known and detection.keypoints is not None else NO_POINTS
    weights = detection.keypoint_scores if known and detection.keypoint_scores is not None else np.zeros(0)
    group = association_group(detection.category)
    return TrackedMask(group, left, top, mask, detection.image_size, points, keypoints, weights)


def shared_area_px(one: TrackedMask, other: TrackedMask) -> int:
    """Count the pixels that two masks share."""
    x0, y0 = np.maximum(one.box[:2], other.box[:2]).astype(int)
    x1, y1 = np.minimum(one.box[2:], other.box[2:]).astype(int)
    if x1 <= x0 or y1 <= y0:
        return 0
    parts = [s.mask[y0 - s.top : y1 - s.top, x0 - s.left : x1 - s.left] for s in (one, other)]
    return int((parts[0] & parts[1]).sum())


def mask_iou(one: TrackedMask, other: TrackedMask) -> float:
    """Intersection over union of two masks of one image."""
    shared = shared_area_px(one, other)
    return shared / max(1, int(one.mask.sum()) + int(other.mask.sum()) - shared)
