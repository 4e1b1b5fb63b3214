"""Points that are followed from image to image: corners and the optical flow of Lucas and Kanade (1981), both ways."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from meshslam.geometry import Bools, Bytes, Floats

WINDOW_PX = 15
LEVELS = 5  # of the pyramid beyond the image itself: near cars move by 100 px a frame


@dataclass(frozen=True, eq=False)
class Flow:
    """Where points of one image are in another, and where they come back to."""

    points: Floats  # (N, 2) px in the other image
    returned: Floats  # (N, 2) px in the first image
    good: Bools  # (N,) followed there and back to the same place

    def part(self, first: int, last: int) -> Flow:
        """Return the points first..last - 1."""
        return Flow(self.points[first:last], self.returned[first:last], self.good[first:last])


def grey(image_bgr: Bytes) -> Bytes:
    """Return the (height, width) brightness, with contrast in dark and bright parts evened out."""
    plain = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY) if image_bgr.ndim == 3 else image_bgr
    return np.asarray(cv2.createCLAHE(clipLimit=3.0, tileGridSize=(8, 8)).apply(plain), np.uint8)


def corners(image: Bytes, mask: Bytes, left: int, top: int, count: int) -> Floats:
    """Find up to `count` corners (N, 2) inside a mask whose top-left pixel is at (left, top) of the grey image."""
    height, width = mask.shape
    margin = 1 if min(height, width) < 40 else 3
    inner = cv2.erode(mask, np.ones((2 * margin + 1, 2 * margin + 1), np.uint8), borderValue=0)
    apart = max(2.0, 0.6 * float(np.sqrt(mask.sum() / max(count, 1))))
    part = np.ascontiguousarray(image[top : top + height, left : left + width])
    found = cv2.goodFeaturesToTrack(part, count, qualityLevel=0.01, minDistance=apart, mask=inner)
    if found is None:
        return np.zeros((0, 2))
    placed: Floats = np.asarray(found, float).reshape(-1, 2) + np.array([left, top])
    return placed


def follow(first: Bytes, other: Bytes, points: Floats, agreement_px: float = 1.5) -> Flow:
    """Follow points (N, 2) from one grey image to another and back; `good` are those that return to `agreement_px`."""
    if len(points) == 0 or first.shape != other.shape:
        return Flow(points, points, np.zeros(len(points), bool))
    there, seen = _lucas_kanade(first, other, points)
    back, seen_back = _lucas_kanade(other, first, there)
    height, width = first.shape
    inside = ((there >= 0) & (there <= (width - 1, height - 1))).all(1)
    near = np.linalg.norm(back - points, axis=1) <= agreement_px
    return Flow(there, back, seen & seen_back & inside & near)


def _lucas_kanade(first: Bytes, other: Bytes, points: Floats) -> tuple[Floats, Bools]:
    start = np.ascontiguousarray(points, np.float32).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.03)
    window = (WINDOW_PX, WINDOW_PX)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        first, other, start, start.copy(), winSize=window, maxLevel=LEVELS, criteria=stop, minEigThreshold=1e-4
    )
    moved = np.asarray(moved, float).reshape(-1, 2)
    usable = (np.asarray(status).reshape(-1) > 0) & np.isfinite(moved).all(1)
    return np.where(usable[:, None], moved, points), usable


def scale_and_shift(points: Floats, moved: Floats) -> tuple[float, Floats, Floats]:
    """Find the median motion of matched points (N, 2): `moved` is about scale * (points - centre) + new_centre.

    Returns scale, centre, new centre (Kalal et al., Forward-backward error, 2010).
    """
    centre, new_centre = np.median(points, axis=0), np.median(moved, axis=0)
    before, after = (np.linalg.norm(p - c, axis=1) for p, c in ((points, centre), (moved, new_centre)))
    far = before > max(1.0, 0.5 * float(np.median(before)))
    scale = float(np.median(after[far] / before[far])) if far.sum() >= 3 else 1.0
    return float(np.clip(scale, 0.5, 2.0)), centre, new_centre
