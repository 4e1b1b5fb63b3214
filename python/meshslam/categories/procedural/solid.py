"""Solids given by a function that is negative inside: the few operations that the families need."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from meshslam.geometry import Floats

Field = Callable[[Floats], Floats]  # points (n, 3) to values (n,), negative inside, in metres near the surface


def smooth_max(a: Floats, b: Floats, radius: Floats | float) -> Floats:
    """Maximum (intersection) whose edge is rounded where |a - b| < radius; never below the maximum."""
    blend = np.maximum(1 - np.abs(a - b) / radius, 0)
    rounded: Floats = np.maximum(a, b) + radius * blend**2 / 4
    return rounded


def smooth_min(a: Floats, b: Floats, radius: Floats | float) -> Floats:
    """Minimum (union) whose valley is filled where |a - b| < radius; never above the minimum."""
    return -smooth_max(-a, -b, radius)


def smooth_step(t: Floats) -> Floats:
    """Rise from 0 at t = 0 to 1 at t = 1 with level ends."""
    s = np.clip(t, 0, 1)
    step: Floats = s * s * (3 - 2 * s)
    return step


def distance_and_normal(field: Field, points: Floats, step: float = 2e-3) -> tuple[Floats, Floats]:
    """First-order signed distance (n,) and unit normal (n, 3) of the field's level set at points (n, 3)."""
    shifts = step * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    values = field((points + shifts[:, None]).reshape(-1, 3)).reshape(7, -1)
    gradient = (values[1:4] - values[4:]).T / (2 * step)
    slope = np.maximum(np.linalg.norm(gradient, axis=1), 0.2)
    return values[0] / slope, gradient / slope[:, None]


def project(field: Field, points: Floats, iterations: int = 6) -> Floats:
    """Move points (n, 3) onto the surface along the field's gradient."""
    for _ in range(iterations):
        distance, normal = distance_and_normal(field, points)
        points = points - np.clip(distance, -0.3, 0.3)[:, None] * normal
    return points


def cast(field: Field, starts: Floats, directions: Floats, reach: float = 4.0) -> Floats:
    """Points (n, 3) where rays that start inside leave the solid for good within `reach` metres."""
    steps = np.linspace(0, reach, 201)
    along = starts[:, None] + steps[:, None] * directions[:, None]
    inside = field(along.reshape(-1, 3)).reshape(len(starts), -1) < 0
    last = inside.shape[1] - 1 - inside[:, ::-1].argmax(1)
    low, high = steps[last], steps[np.minimum(last + 1, len(steps) - 1)]
    for _ in range(30):
        middle = (low + high) / 2
        within = field(starts + middle[:, None] * directions) < 0
        low, high = np.where(within, middle, low), np.where(within, high, middle)
    points: Floats = starts + low[:, None] * directions
    return points


def curve_distance(points: Floats, curve: Floats, spacing: float = 0.004) -> Floats:
    """Signed distance (n,) of points (n, 2) to a closed counter-clockwise curve (m, 2), negative inside.

    The curve is sampled every `spacing`; the sign is that of the nearest sample's outward normal.
    """
    side = np.roll(curve, -1, axis=0) - curve
    length = np.linalg.norm(side, axis=1)
    count = np.ceil(length / spacing).astype(int)
    index = np.repeat(np.arange(len(curve)), count)
    share = (np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[index]
    samples = curve[index] + share[:, None] * side[index]
    normal = np.stack([side[index, 1], -side[index, 0]], 1) / length[index, None]
    tree = cKDTree(samples, balanced_tree=False, compact_nodes=False)  # samples are even: 2.5 times as fast to ask
    distance, nearest = tree.query(points)
    across = ((points - samples[nearest]) * normal[nearest]).sum(1)
    signed: Floats = np.where(distance < 2 * spacing, across, np.copysign(distance, across))
    return signed
