"""Key points as fixed sums of vertices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshslam.geometry import Floats, Ints

LEAST_SHARE = 0.02
KEYPOINT_NAMES: tuple[str, ...] = (
    "left_front_wheel",
    "left_back_wheel",
    "right_front_wheel",
    "right_back_wheel",
    "upper_left_windshield",
    "upper_right_windshield",
    "upper_left_rearwindow",
    "upper_right_rearwindow",
    "left_front_light",
    "right_front_light",
    "left_back_trunk",
    "right_back_trunk",
)


def keypoint_order(detected: Sequence[str], known: Sequence[str]) -> list[int]:
    """The number, among an object's `known` key points, of each that is `detected`; -1 for one it does not have."""
    return [known.index(name) if name in known else -1 for name in detected]


def point_weights(shapes: Floats, points: Floats, candidates: int = 40) -> Floats:
    """Weights (K, V), few of them positive and none negative, so that `weights @ shape` is nearest to the points.

    shapes (N, V, 3), points (N, K, 3) of the same frames. For each point the vertices that stay nearest to it share
    a weight of 1 by non-negative least squares over all shapes, which leaves most of them at zero.
    """
    weights = np.zeros((points.shape[1], shapes.shape[1]))
    for k in range(points.shape[1]):
        gap = ((shapes - points[:, k : k + 1]) ** 2).sum(2).mean(0)
        near = np.sort(np.argsort(gap, kind="stable")[:candidates])
        weights[k, near] = _shares(shapes[:, near], points[:, k])
    return weights


def mirrored_weights(weights: Floats, mirror: Ints, names: tuple[str, ...]) -> Floats:
    """The weights (K, V) with each right point's row made the mirror image of its left twin's, where names tell one."""
    result = weights.copy()
    for row, name in enumerate(names):
        twin = name.replace("right", "left")
        if twin != name and twin in names:
            result[row] = weights[names.index(twin)][mirror]
    return result


def _shares(corners: Floats, points: Floats) -> Floats:
    """Non-negative shares (C,) of sum 1 that take corners (N, C, 3) nearest to points (N, 3)."""
    from scipy.optimize import nnls  # slow to import

    origin = points.mean(0)
    system = (corners - origin).transpose(0, 2, 1).reshape(-1, corners.shape[1])
    whole = 1e3 * np.sqrt((system**2).sum(0).mean())
    found, _ = nnls(np.vstack([system, np.full(corners.shape[1], whole)]), np.append((points - origin).ravel(), whole))
    kept = np.where(found > LEAST_SHARE * found.sum(), found, 0.0)
    shares: Floats = kept / kept.sum()
    return shares
