"""The part of an image that the key point network sees, and back to the image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from meshslam.geometry import Bytes, Floats, Singles

WIDTH_PX = 128  # of the network's input
HEIGHT_PX = 96  # of the network's input
ROOM = 1.25  # the crop's sides over the box's
GREY = 114  # beyond the image's border


@dataclass(frozen=True)
class Crop:
    """A rectangle of an image, of the input's shape; it may reach beyond the image."""

    x0: int
    y0: int
    width: int
    height: int

    @staticmethod
    def around(box: tuple[float, float, float, float]) -> Crop:
        """The rectangle about a box (x, y, width, height: px), `ROOM` times its size along the longer side."""
        x, y, w, h = box
        scale = max(ROOM * w / WIDTH_PX, ROOM * h / HEIGHT_PX, 1.0 / 16)
        width, height = max(2, round(scale * WIDTH_PX)), max(2, round(scale * HEIGHT_PX))
        return Crop(round(x + w / 2 - width / 2), round(y + h / 2 - height / 2), width, height)

    @property
    def scale(self) -> Floats:
        """Input pixels per image pixel along x and y, (2,)."""
        return np.array([WIDTH_PX / self.width, HEIGHT_PX / self.height])

    def to_input(self, points_in_image: Floats) -> Floats:
        """Take points (..., 2) from the image to the input; pixel centres are at whole numbers in both."""
        moved: Floats = (points_in_image - [self.x0, self.y0] + 0.5) * self.scale - 0.5
        return moved

    def to_image(self, points_in_input: Floats) -> Floats:
        """Take points (..., 2) from the input to the image."""
        moved: Floats = (points_in_input + 0.5) / self.scale - 0.5 + [self.x0, self.y0]
        return moved

    def window(self, picture: Bytes, beyond: int) -> Bytes:
        """The rectangle of a picture (h, w) or (h, w, 3); `beyond` fills what lies outside of it."""
        height, width = picture.shape[:2]
        x0, y0 = max(0, self.x0), max(0, self.y0)
        x1, y1 = min(width, self.x0 + self.width), min(height, self.y0 + self.height)
        canvas = np.full((self.height, self.width, *picture.shape[2:]), beyond, np.uint8)
        if x1 > x0 and y1 > y0:
            canvas[y0 - self.y0 : y1 - self.y0, x0 - self.x0 : x1 - self.x0] = picture[y0:y1, x0:x1]
        return canvas

    def cut(self, picture: Bytes, beyond: int) -> Bytes:
        """The rectangle of a picture, resampled to the input's size."""
        return _resampled(self.window(picture, beyond))


def _resampled(window: Bytes) -> Bytes:
    method = cv2.INTER_AREA if window.shape[1] > WIDTH_PX else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(window, (WIDTH_PX, HEIGHT_PX), interpolation=method), np.uint8)


def cut_out(image_bgr: Bytes, mask: Bytes, crop: Crop) -> Bytes:
    """Blue, green, red and mask (0 or 255) of a crop: (HEIGHT_PX, WIDTH_PX, 4)."""
    colour = crop.window(image_bgr, GREY)
    shown = crop.window(mask, 0) * np.uint8(255)
    planes = [colour, shown] if colour.ndim == 3 else [colour, colour, colour, shown]
    return _resampled(np.asarray(cv2.merge(planes), np.uint8))


def to_input(cuts: Bytes) -> Singles:
    """Inputs (N, 4, h, w) of crops (N, h, w, 4): colours less their mean on the mask, over their spread there."""
    inputs = np.empty((len(cuts), 4, *cuts.shape[1:3]), np.float32)
    for planes, cut in zip(inputs, cuts, strict=True):
        planes[:] = cut.transpose(2, 0, 1)
        planes *= np.float32(1 / 255)
        mean, spread = _brightness(planes)
        planes[:3] -= mean
        planes[:3] /= spread + np.float32(0.03)
        np.clip(planes[:3], -4, 4, out=planes[:3])
        planes[3] = 2 * planes[3] - 1
    return inputs


def _brightness(planes: Singles) -> tuple[np.float32, np.float32]:
    """Mean and spread of three colours (4, h, w), weighed by the mask after them."""
    colours, weight = planes[:3].reshape(3, -1), planes[3].reshape(-1) + np.float32(0.02)
    total = 3 * weight.sum()
    mean = (colours @ weight).sum() / total
    return mean, np.sqrt((np.square(colours - mean) @ weight).sum() / total)
