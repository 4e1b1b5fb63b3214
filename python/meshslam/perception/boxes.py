"""How boxes on an image lie to each other."""

from __future__ import annotations

from meshslam.perception.detections import Detection

NEAR_PX = 8.0  # boxes nearer to each other than this may hide each other's border


def are_near(one: Detection, other: Detection) -> bool:
    """Whether two detections' boxes overlap, or nearly."""
    (ax, ay, aw, ah), (bx, by, bw, bh) = one.bbox, other.bbox
    return max(max(ax, bx) - min(ax + aw, bx + bw), max(ay, by) - min(ay + ah, by + bh)) < NEAR_PX


def nearness_on_ground(detection: Detection) -> tuple[float, float]:
    """Larger for what stands nearer on level ground: the lowest row, then the box's area (boxes cut at the bottom)."""
    return round(detection.bbox[1] + detection.bbox[3], 1), detection.bbox[2] * detection.bbox[3]
