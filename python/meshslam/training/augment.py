"""Variations of drawn crops: mirrored, shifted, scaled, turned, with parts of the mask or of the image gone."""

from __future__ import annotations

import cv2
import numpy as np

from meshslam.geometry import Bytes, Floats
from meshslam.perception import GREY, MIRRORED
from meshslam.training.dataset import Samples, in_crop


def varied(rng: np.random.Generator, samples: Samples) -> Samples:
    """Vary every sample."""
    changed = [_varied(rng, samples, i) for i in range(len(samples))]
    cuts, keypoints, visible, angles = zip(*changed, strict=True)
    return Samples(np.stack(cuts), np.stack(keypoints), np.stack(visible), np.array(angles), samples.boxes_px)


def _varied(rng: np.random.Generator, samples: Samples, i: int) -> tuple[Bytes, Floats, Floats, float]:
    cut, keypoints, visible = samples.cuts[i], samples.keypoints[i], samples.visible[i]
    angle = float(samples.angles_rad[i])
    height, width = cut.shape[:2]
    if rng.random() < 0.5:
        cut, angle = np.ascontiguousarray(cut[:, ::-1]), -angle
        keypoints, visible = ([width - 1, 0] + keypoints * [-1, 1])[MIRRORED], visible[MIRRORED]
    scale, turn = np.exp(rng.normal(0, 0.06)), rng.normal(0, 0.04)
    linear = scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    shift = middle + rng.normal(0, 2.5, 2) - linear @ middle
    beyond = (GREY, GREY, GREY, 0)
    warped = cv2.warpAffine(cut, np.column_stack([linear, shift]), (width, height), borderValue=beyond)
    keypoints = keypoints @ linear.T + shift
    visible = visible * in_crop(keypoints)
    moved = np.asarray(warped, np.uint8)
    _grade(rng, moved)
    _erase(rng, moved, keypoints, visible)
    return moved, keypoints, visible, angle


def _grade(rng: np.random.Generator, cut: Bytes) -> None:
    """Another curve of brightness, in place: what is dark and what is bright stays so."""
    if rng.random() < 0.5:
        return
    curve = 255 * (np.arange(256) / 255) ** np.exp(rng.normal(0, 0.3))
    cut[..., :3] = curve.astype(np.uint8)[cut[..., :3]]


def _erase(rng: np.random.Generator, cut: Bytes, keypoints: Floats, visible: Floats) -> None:
    """Noise over a rectangle of the image, or its mask gone, in place: points in the first are not seen."""
    kind = rng.random()
    if kind > 0.35:
        return
    height, width = cut.shape[:2]
    w, h = (rng.uniform(0.1, 0.4, 2) * [width, height]).astype(int)
    x, y = int(rng.integers(0, width - w)), int(rng.integers(0, height - h))
    part = cut[y : y + h, x : x + w]
    if kind > 0.17:
        part[..., 3] = 0 if kind > 0.23 else 255
        return
    part[..., :3] = rng.integers(0, 256, 3 if rng.random() < 0.5 else part[..., :3].shape)
    part[..., 3] = 0
    inside = ((keypoints >= [x, y]) & (keypoints < [x + w, y + h])).all(1)
    visible[inside] = 0
