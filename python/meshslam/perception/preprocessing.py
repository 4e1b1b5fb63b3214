"""What a network expects of an image: colours, range, and how it is brought to the input's size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshslam.geometry import Bytes, Singles

Fit = Literal["letterbox", "stretch"]
IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class Preprocessing:
    """How pixels become values; the default is that of YOLO networks: RGB from 0 to 1 in a grey frame."""

    white: float = 1.0  # value of 255
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)  # in the channels' order, subtracted after scaling
    std: tuple[float, ...] = (1.0, 1.0, 1.0)
    channels: Literal["rgb", "bgr"] = "rgb"
    fit: Fit = "letterbox"
    antialias: bool = True  # average what becomes smaller, as if seen from farther away
    fill: int = 114  # beside a letterboxed image, 0 to 255
    size: tuple[int, int] | None = None  # height, width: px, of networks that leave it open

    def values(self, canvas_bgr: Bytes) -> Singles:
        """The input (1, 3, h, w) of an image (h, w, 3) that has the input's size."""
        ordered = canvas_bgr[..., ::-1] if self.channels == "rgb" else canvas_bgr
        values = np.ascontiguousarray(ordered[None].transpose(0, 3, 1, 2), dtype=np.float32)
        if self.white != 255:
            values /= np.float32(255 / self.white)
        if any(self.mean) or any(v != 1 for v in self.std):
            shift, scale = (np.array(v, np.float32).reshape(1, 3, 1, 1) for v in (self.mean, self.std))
            values = (values - shift) / scale
        return values

    def text(self) -> str:
        """In words, for a note."""
        scaled = "" if self == type(self)(fit=self.fit, fill=self.fill, size=self.size) else " as told"
        normalised = f", less {self.mean}, divided by {self.std}" if any(self.mean) else scaled
        return f"{self.channels.upper()} from 0 to {self.white:g}{normalised}, {_FITS[self.fit]}"


_FITS = {"letterbox": "letterboxed", "stretch": "stretched to the input"}
RF_DETR = Preprocessing(mean=IMAGENET_MEAN, std=IMAGENET_STD, fit="stretch", antialias=False)  # trained so
