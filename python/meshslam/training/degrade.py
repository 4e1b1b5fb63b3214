"""From a clean picture to what a network gets: things in the way, cut borders, a segmenter's mask, a camera's image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from meshslam.geometry import Bools, Bytes, Singles
from meshslam.training.background import clouded
from meshslam.training.scene import Picture, as_bytes

_GREY = np.array([[0.114], [0.587], [0.299]], np.float32)


@dataclass(frozen=True, eq=False)
class Seen:
    """An image with a detection's mask."""

    image_bgr: Bytes  # (h, w, 3)
    mask: Bytes  # (h, w), zeros and ones


def obstructed(rng: np.random.Generator, picture: Picture) -> Picture:
    """Put poles, hedges, people before the car, at times."""
    if rng.random() > 0.25:
        return picture
    image, cover = picture.image_bgr.copy(), np.zeros(picture.mask.shape[:2], np.uint8)
    height, width = picture.mask.shape
    for _ in range(int(rng.integers(1, 3))):
        x, y = int(rng.integers(0, width)), int(rng.integers(0, height))
        kind = rng.random()
        if kind < 0.45:
            half = max(1, int(rng.uniform(0.01, 0.06) * width))
            cv2.rectangle(cover, (x - half, 0), (x + half, int(height * rng.uniform(0.6, 1.0))), 1, cv2.FILLED)
        elif kind < 0.75:
            cv2.rectangle(cover, (x, int(height * rng.uniform(0.55, 0.9))), (x + width // 3, height), 1, cv2.FILLED)
        else:
            axes = (max(2, int(0.07 * width)), max(3, int(0.25 * height)))
            cv2.ellipse(cover, (x, y), axes, 0, 0, 360, 1, cv2.FILLED)
    colour = np.clip(rng.uniform(0.02, 0.8) + rng.normal(0, 0.1, 3), 0, 1)
    grain = 1 + 0.3 * clouded(rng, height, width, int(rng.integers(4, 40)))
    image[cover > 0] = (colour * grain[..., None])[cover > 0]
    return replace(
        picture, image_bgr=image, mask=picture.mask & (cover == 0), visible=picture.visible & ~_covered(picture, cover)
    )


def _covered(picture: Picture, cover: Bytes) -> Bools:
    height, width = cover.shape
    x, y = np.clip(np.round(picture.keypoints), 0, [width - 1, height - 1]).astype(int).T
    hidden: Bools = cover[y, x] > 0
    return hidden


def cut(rng: np.random.Generator, picture: Picture) -> Picture:
    """Let the image's border cut the car, at times."""
    if rng.random() > 0.15:
        return picture
    columns = np.flatnonzero(picture.mask.any(0))
    if len(columns) < 8:
        return picture
    share = rng.uniform(0.05, 0.5)
    at = int(columns[0] + share * (columns[-1] - columns[0]))
    left = rng.random() < 0.5
    if not left:
        at = int(columns[-1] - share * (columns[-1] - columns[0]))
    part = slice(at, None) if left else slice(None, at + 1)
    shift = at if left else 0
    x = picture.keypoints[:, 0]
    inside = x >= at - 0.5 if left else x <= at + 0.5
    return replace(
        picture,
        image_bgr=picture.image_bgr[:, part],
        mask=picture.mask[:, part],
        others=picture.others[:, part],
        keypoints=picture.keypoints - [shift, 0],
        visible=picture.visible & inside,
    )


def segmented(rng: np.random.Generator, picture: Picture) -> Bytes:
    """Roughen the mask as a segmenter does: coarse cells, soft corners, neighbours taken in, parts missing."""
    mask = picture.mask.astype(np.float32)
    height, width = mask.shape
    if rng.random() < 0.18 and picture.others.any():
        reach = max(3, int(rng.uniform(0.05, 0.35) * max(height, width))) | 1
        near = cv2.dilate(mask.astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0
        mask[near & picture.others] = 1
    if rng.random() < 0.12:
        _drop(rng, mask)
    cell = rng.uniform(1.0, 5.0)
    small = (max(6, round(width / cell)), max(6, round(height / cell)))
    coarse = cv2.resize(mask, small, interpolation=cv2.INTER_AREA)
    soft = cv2.GaussianBlur(coarse, (0, 0), rng.uniform(0.3, 1.0))
    soft = cv2.resize(soft, (width, height), interpolation=cv2.INTER_LINEAR)
    level = 0.5 + rng.normal(0, 0.08) + 0.2 * clouded(rng, height, width, int(rng.integers(3, 12)))
    rough = (soft > level).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(rough, connectivity=8)
    if count < 2:
        return rough
    keep = stats[:, cv2.CC_STAT_AREA] >= 0.05 * stats[1:, cv2.CC_STAT_AREA].max()
    keep[0] = False
    return np.asarray(keep[labels], np.uint8)


def _drop(rng: np.random.Generator, mask: np.ndarray) -> None:
    rows, columns = np.nonzero(mask > 0)
    if len(rows) < 20:
        return
    top, bottom, left, right = rows.min(), rows.max(), columns.min(), columns.max()
    share = rng.uniform(0.03, 0.25)
    side = int(rng.integers(4))
    if side == 0:
        mask[: int(top + share * (bottom - top))] = 0
    elif side == 1:
        mask[int(bottom - share * (bottom - top)) :] = 0
    elif side == 2:
        mask[:, : int(left + share * (right - left))] = 0
    else:
        mask[:, int(right - share * (right - left)) :] = 0


def photographed(rng: np.random.Generator, colour: Singles) -> Bytes:
    """Expose, blur, add noise, compress."""
    peak = float(np.quantile(colour[::3, ::3], rng.uniform(0.8, 0.995))) + 0.05
    image = np.clip(colour * np.float32(rng.uniform(0.55, 1.1) / peak), 0, 1)
    cv2.pow(image, rng.uniform(0.5, 0.9), image)
    image = _graded(rng, image)
    if rng.random() < 0.5:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 0.006 * max(image.shape) + 0.8))
    if rng.random() < 0.2:
        image = cv2.blur(image, (int(rng.integers(2, 6)), 1))
    image = image + _noise(rng, 0.03, (*image.shape[:2], 1)) + _noise(rng, 0.02, image.shape)
    found = as_bytes(image)
    if rng.random() < 0.4:
        _, code = cv2.imencode(".jpg", found, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(35, 95))])
        found = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), np.uint8)
    return found


def _graded(rng: np.random.Generator, image: Singles) -> Singles:
    """Another contrast, brightness and saturation, or grey."""
    image = np.clip(
        (image - np.float32(0.5)) * np.float32(rng.uniform(0.7, 1.3)) + np.float32(0.5 + rng.normal(0, 0.05)), 0, 1
    )
    if rng.random() < 0.35:
        return np.repeat(image @ _GREY, 3, axis=2)
    image = np.clip(image * (1 + rng.normal(0, 0.06, 3)).astype(np.float32), 0, 1)
    grey = image.mean(2, keepdims=True)
    coloured: Singles = np.clip(grey + (image - grey) * np.float32(rng.uniform(0.3, 1.4)), 0, 1)
    return coloured


def _noise(rng: np.random.Generator, most: float, shape: tuple[int, ...]) -> Singles:
    return rng.standard_normal(shape, np.float32) * np.float32(rng.uniform(0.0, most))


def seen(rng: np.random.Generator, picture: Picture) -> Seen:
    """The image and the mask of a picture."""
    return Seen(photographed(rng, picture.image_bgr), segmented(rng, picture))
