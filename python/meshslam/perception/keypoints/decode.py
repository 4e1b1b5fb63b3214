"""From the network's maps to key points with sigmas, and to a viewing angle."""

from __future__ import annotations

import numpy as np

from meshslam.geometry import Floats, Singles

KEYPOINTS = 12
ANGLES = 36  # bins of the viewing angle; the first one's centre is 0
CELL_PX = 4  # of the input, a cell of a heat map
REACH = 2  # cells about the peak that say where the point is


def points_in_input(heat: Singles) -> tuple[Floats, Floats]:
    """Where heat maps (N, K, h, w; logits) have their points: (N, K, 2) px of the input, and the share of each (N, K).

    The mean over the cells around the peak (a local soft argmax); the share is what the map gives to these cells.
    """
    n, k, height, width = heat.shape
    flat = heat.reshape(n, k, -1).astype(float)
    flat = np.exp(flat - flat.max(2, keepdims=True))
    flat /= flat.sum(2, keepdims=True)
    row, column = np.divmod(flat.argmax(2), width)
    near_rows = np.abs(np.arange(height) - row[..., None]) <= REACH
    near_columns = np.abs(np.arange(width) - column[..., None]) <= REACH
    near = flat.reshape(n, k, height, width) * near_rows[..., None] * near_columns[:, :, None]
    share = near.sum((2, 3))
    x = (near.sum(2) * np.arange(width)).sum(2) / share
    y = (near.sum(3) * np.arange(height)).sum(2) / share
    points: Floats = CELL_PX * (np.stack([x, y], -1) + 0.5) - 0.5
    return points, share


def laplace_sigma(log_scale: Singles) -> Floats:
    """Standard deviations along one axis of Laplace distributions, from the logs of their scales."""
    sigma: Floats = np.sqrt(2.0) * np.exp(log_scale.astype(float))
    return sigma


def angle_distribution(logits: Singles) -> Floats:
    """Probabilities (N, `ANGLES`) of the viewing angle's bins."""
    shifted = np.exp(logits.astype(float) - logits.max(1, keepdims=True))
    shares: Floats = shifted / shifted.sum(1, keepdims=True)
    return shares


def keypoint_scores(share: Floats, visible: Singles, angle_shares: Floats) -> Floats:
    """Scores (N, K): that a point is seen, in one place, and that front is not taken for rear.

    share (N, K) of `points_in_input`, visible (N, K) logits, angle_shares (N, `ANGLES`).
    """
    facing = 1 - reversed_share(angle_shares)
    scores: Floats = facing[:, None] * share / (1 + np.exp(-visible.astype(float)))
    return scores


def reversed_share(shares: Floats) -> Floats:
    """The share (N,) of angle distributions that lies more than a quarter turn off the likeliest angle."""
    away = np.cos(angle_centres() - peak_angle(shares)[:, None]) < 0
    total: Floats = (shares * away).sum(1)
    return total


def angle_centres() -> Floats:
    """Centres (`ANGLES`,) of the bins, rad: 0 ahead of the car, pi / 2 at its left."""
    centres: Floats = 2 * np.pi * np.arange(ANGLES) / ANGLES
    return centres


def peak_angle(shares: Floats) -> Floats:
    """The viewing angle (N,) of distributions: the mean direction of the peak's bin and two on each side."""
    peak = shares.argmax(1)
    near = (peak[:, None] + np.arange(-2, 3)) % ANGLES
    weight = np.take_along_axis(shares, near, 1)
    angle: Floats = np.angle((weight * np.exp(1j * angle_centres()[near])).sum(1))
    return angle
