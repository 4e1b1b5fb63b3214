"""The noise of a sequence's masks, from what the fitted meshes leave over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from meshslam.geometry import Floats, NoiseModel

_MINIMUM_POINTS = 300
_LONGEST_LAG = 40  # border points
_SIGMA_RANGE_PX = (0.7, 6.0)
_CORRELATION_RANGE_PX = (8.0, 80.0)


def estimated_noise(distances_px: Sequence[Floats], spacing_px: float, noise: NoiseModel) -> NoiseModel:
    """The noise model with the border's sigma and correlation length of these distances.

    Each array holds signed distances of border points to the outline in their order along the border, NaN where the
    border is not the object's own. Sigma is 1.4826 times the median absolute distance; the correlation length is the
    integral of the autocorrelation up to its first zero, both sides. With too few points the model stays as it is.
    """
    everything = np.concatenate([d[np.isfinite(d)] for d in distances_px]) if distances_px else np.zeros(0)
    if len(everything) < _MINIMUM_POINTS:
        return noise
    sigma = 1.4826 * float(np.median(np.abs(everything)))
    length = spacing_px * (1.0 + 2.0 * float(autocorrelation(distances_px, 3 * sigma).sum()))
    return replace(
        noise,
        border_sigma_px=float(np.clip(sigma, *_SIGMA_RANGE_PX)),
        border_correlation_px=float(np.clip(length, *_CORRELATION_RANGE_PX)),
    )


def autocorrelation(distances_px: Sequence[Floats], max_px: float) -> Floats:
    """Autocorrelation at lags 1, 2, ... of border points up to its first zero; distances are cut at `max_px`."""
    products, counts = np.zeros(_LONGEST_LAG + 1), np.zeros(_LONGEST_LAG + 1)
    for row in distances_px:
        seen = np.isfinite(row)
        value = np.where(seen, np.clip(row, -max_px, max_px), 0.0)
        for lag in range(min(_LONGEST_LAG + 1, len(row))):
            products[lag] += float((value[: len(row) - lag] * value[lag:]).sum())
            counts[lag] += int((seen[: len(row) - lag] & seen[lag:]).sum())
    covariance = products / np.maximum(counts, 1)
    if covariance[0] <= 0:
        return np.zeros(0)
    ratio = covariance[1:] / covariance[0]
    ends = np.flatnonzero((ratio <= 0) | (counts[1:] == 0))
    tail: Floats = ratio[: int(ends[0])] if len(ends) else ratio
    return tail
