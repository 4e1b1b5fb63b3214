"""How the ground is laid on paper: one scale, turned so that a path runs across."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats

WIDTH_PX, TALLEST_PX, MARGIN_PX, LOWEST_PX = 1160.0, 620.0, 44.0, 200.0
LARGEST_SCALE = 45.0  # px/m
SCALE_BAR_PX = 140.0  # at most
BAND_PX = 24.0  # below the drawing, for the scale
PATH_POINTS = 2000


@dataclass(frozen=True, eq=False)
class Plan:
    """How the ground is laid on paper: turned, so that the path runs across, one scale for both axes, y up."""

    rotation: Floats  # (2, 2), paper's axes (right, up) from world's x, y
    scale_px_per_m: float
    origin: Floats  # (2,), what lies at the left and bottom, metres along the paper's axes
    width_px: float
    height_px: float
    margin: Floats  # (2,), from the left and from the bottom, px

    def pixels(self, points_in_world: Floats) -> Floats:
        """Pixels (..., 2) of points (..., 2 or 3)."""
        paper = (points_in_world[..., :2] @ self.rotation.T - self.origin) * self.scale_px_per_m + self.margin
        paper[..., 1] = self.height_px - paper[..., 1]
        return paper


def make_plan(path_in_world: Floats, points_in_world: Floats) -> Plan:
    """Fit a path (n, 3) and other points (m, 3) on the paper."""
    rotation = _across(path_in_world if len(path_in_world) > 1 else points_in_world)
    everything = np.concatenate([path_in_world, points_in_world])[:, :2] @ rotation.T
    low = everything.min(axis=0) if len(everything) else np.zeros(2)
    size = np.maximum((everything.max(axis=0) if len(everything) else np.ones(2)) - low, 1.0)
    room = np.array([WIDTH_PX, TALLEST_PX]) - 2 * MARGIN_PX
    scale = min(float((room / size).min()), LARGEST_SCALE)
    height = max(float(size[1]) * scale + 2 * MARGIN_PX, LOWEST_PX)
    margin = (np.array([WIDTH_PX, height]) - size * scale) / 2
    return Plan(rotation, scale, low, WIDTH_PX, height, margin)


def px(value: float) -> str:
    """A coordinate to a tenth of a pixel, no zeros behind."""
    return f"{round(value, 1) + 0.0:.1f}".removesuffix(".0")


def _across(points: Floats) -> Floats:
    """Turn the points' main direction to the right, in the order in which they come."""
    flat = points[:, :2] - points[:, :2].mean(axis=0) if len(points) else np.zeros((1, 2))
    _, spread, axes = np.linalg.svd(flat, full_matrices=True)
    if spread[0] < 1e-6:
        return np.eye(2)
    right = axes[0] if (flat[-1] - flat[0]) @ axes[0] >= 0 else -axes[0]
    return np.array([right, [-right[1], right[0]]])
