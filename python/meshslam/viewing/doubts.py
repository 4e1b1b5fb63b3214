"""Why an object of a map may not be as it is drawn, in words."""

from __future__ import annotations

import numpy as np

from meshslam.maps import MapObject
from meshslam.viewing.from_above import position_covariance

LARGE_SIGMA_M = 0.3  # of the position, along its least certain axis
LITTLE_SEEN = 0.05  # share of the vertices
FEW_VIEWS = 3
LOW_MASK_IOU = 0.8


def doubts(thing: MapObject) -> list[str]:
    """Reasons to doubt an object, each a phrase with its figure; empty if there are none."""
    sigma, seen = position_sigma_m(thing), seen_share(thing)
    found = []
    if sigma is not None and sigma > LARGE_SIGMA_M:
        found.append(f"its position is uncertain: sigma is {sigma:.2f} m")
    if seen is not None and seen < LITTLE_SEEN:
        found.append(f"views fix {100 * seen:.0f}% of its surface to 5 cm, the rest follows the category's shapes")
    if 0 < thing.views < FEW_VIEWS:
        found.append("one view shows it" if thing.views == 1 else f"{thing.views} views show it")
    if thing.mask_iou is not None and thing.mask_iou < LOW_MASK_IOU:
        found.append(f"it agrees badly with its masks: IoU {thing.mask_iou:.2f}")
    return found


def position_sigma_m(thing: MapObject) -> float | None:
    """Standard deviation of an object's position along its least certain axis, metres."""
    covariance = position_covariance(thing)
    return None if covariance is None else float(np.sqrt(max(np.linalg.eigvalsh(covariance).max(), 0.0)))


def seen_share(thing: MapObject) -> float | None:
    """Share of the vertices that some view shows."""
    return None if thing.vertex_observed is None else float(np.mean(thing.vertex_observed))
