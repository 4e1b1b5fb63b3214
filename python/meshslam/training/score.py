"""How good answers on samples are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Singles
from meshslam.perception import angle_distribution, laplace_sigma, peak_angle, points_in_input
from meshslam.training.dataset import Samples

PCK_SHARE = 0.1  # of the box's longer side


@dataclass(frozen=True)
class Score:
    """Figures over samples."""

    pck: float  # share of the visible key points that are found within `PCK_SHARE` of the box's longer side
    error_median_share: float  # their median error over the box's longer side
    visible_accuracy: float
    angle_median_deg: float
    flips: float  # share of the viewing angles off by more than a quarter turn
    sigma_ratio: float  # root of the mean squared error over sigma along one axis, errors within PCK_SHARE: 1 is right


def score(heat: Singles, visible: Singles, log_sigma: Singles, angle: Singles, truth: Samples) -> Score:
    """Compare a network's answers with the truth."""
    points, _ = points_in_input(heat)
    shown = truth.visible > 0
    gap = points - truth.keypoints
    size = truth.boxes_px.max(1)[:, None]
    off = np.linalg.norm(gap, axis=2) / size
    good = shown & (off <= PCK_SHARE)
    turn = np.abs(np.degrees(_wrapped(peak_angle(angle_distribution(angle)) - truth.angles_rad)))
    whitened = gap / laplace_sigma(log_sigma)[..., None]
    return Score(
        float(good.sum() / shown.sum()),
        float(np.median(off[shown])),
        float(((visible > 0) == shown).mean()),
        float(np.median(turn)),
        float((turn > 90).mean()),
        float(np.sqrt((whitened[good] ** 2).mean())),
    )


def _wrapped(angle: Floats) -> Floats:
    turned: Floats = np.mod(angle + np.pi, 2 * np.pi) - np.pi
    return turned
