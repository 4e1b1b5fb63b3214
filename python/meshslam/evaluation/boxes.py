"""Boxes that stand on the ground: overlap from above and in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Pose


@dataclass(frozen=True, eq=False)
class GroundBox:
    """A box with level base: the bounding box of an object whose x axis is turned by yaw about z."""

    centre: Floats  # (3,), metres
    dimensions: Floats  # (3,), length, width, height, metres
    yaw_rad: float

    @staticmethod
    def of(pose: Pose, dimensions: Floats) -> GroundBox:
        """The box of an object; its tilt is left out, as in KITTI's labels."""
        return GroundBox(pose.translation, dimensions, pose.yaw_rad)

    def corners(self) -> Floats:
        """Corners (4, 2) from above, counterclockwise."""
        half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * self.dimensions[:2] / 2
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        found: Floats = half @ np.array([[c, s], [-s, c]]) + self.centre[:2]
        return found

    @property
    def span(self) -> tuple[float, float]:
        """Lowest and highest z."""
        half = self.dimensions[2] / 2
        return float(self.centre[2] - half), float(self.centre[2] + half)


def box_ious(one: GroundBox, other: GroundBox) -> tuple[float, float]:
    """Intersection over union of two boxes from above, and in space; from 0 to 1."""
    reach = sum(float(np.linalg.norm(box.dimensions[:2])) for box in (one, other)) / 2
    if np.linalg.norm(one.centre[:2] - other.centre[:2]) > reach:
        return 0.0, 0.0
    shared = polygon_area(clipped(one.corners(), other.corners()))
    areas = [float(np.prod(box.dimensions[:2])) for box in (one, other)]
    height = max(0.0, min(one.span[1], other.span[1]) - max(one.span[0], other.span[0]))
    volumes = [float(np.prod(box.dimensions)) for box in (one, other)]
    return _over_union(shared, sum(areas)), _over_union(shared * height, sum(volumes))


def clipped(polygon: Floats, convex: Floats) -> Floats:
    """The part (k, 2) of a polygon (n, 2) inside a convex one (m, 2), both counterclockwise (Sutherland-Hodgman)."""
    for start, end in zip(convex, np.roll(convex, -1, axis=0), strict=True):
        if not len(polygon):
            break
        along = end - start
        side = along[0] * (polygon[:, 1] - start[1]) - along[1] * (polygon[:, 0] - start[0])
        kept = []
        for p, q, at_p, at_q in zip(polygon, np.roll(polygon, -1, axis=0), side, np.roll(side, -1), strict=True):
            if at_p >= 0:
                kept.append(p)
            if (at_p >= 0) != (at_q >= 0):
                kept.append(p + at_p / (at_p - at_q) * (q - p))
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def polygon_area(polygon: Floats) -> float:
    """Area of a polygon (n, 2), m²; 0 for fewer than three corners."""
    x, y = polygon[:, 0], polygon[:, 1]
    return abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())) / 2


def _over_union(shared: float, total: float) -> float:
    return shared / (total - shared) if total > shared else 1.0
