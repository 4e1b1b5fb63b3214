"""A second look in the mirror at cars that may face either way: the mean of both answers is wrong less often."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from meshslam.categories import KEYPOINT_NAMES
from meshslam.geometry import Bools, Singles
from meshslam.perception.keypoints.decode import ANGLES, angle_distribution, reversed_share

UNDECIDED = 0.15  # share of the viewing angles more than a quarter turn off the likeliest

Answers = tuple[Singles, ...]  # heat maps (N, 12, h, w), visibilities (N, 12), log sigmas (N, 12), angles (N, ANGLES)

_SIDES = {"left": "right", "right": "left"}
MIRRORED = np.array(
    [KEYPOINT_NAMES.index("_".join(_SIDES.get(word, word) for word in name.split("_"))) for name in KEYPOINT_NAMES]
)


def answers_of(network: Callable[[Singles], Answers], crops: Singles) -> Answers:
    """What a network says of crops (N, 4, h, w), and of the undecided ones also in the mirror."""
    answers = network(crops)
    again = np.flatnonzero(undecided(answers[3]))
    if len(again):
        second = mirrored(network(np.ascontiguousarray(crops[again, :, :, ::-1])))
        for first, other in zip(answers, second, strict=True):
            first[again] = (first[again] + other) / 2
    return answers


def undecided(angle: Singles) -> Bools:
    """For which distributions (N, ANGLES; logits) another side of the car is likely, too."""
    found: Bools = reversed_share(angle_distribution(angle)) > UNDECIDED
    return found


def mirrored(answers: Answers) -> Answers:
    """Answers on mirrored crops as answers on the crops."""
    heat, visible, log_sigma, angle = answers
    return (
        heat[:, MIRRORED, :, ::-1],
        visible[:, MIRRORED],
        log_sigma[:, MIRRORED],
        angle[:, -np.arange(ANGLES) % ANGLES],
    )
