"""Training samples: crops with their labels, each taken from a drawn picture in a way of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from meshslam.geometry import Bools, Bytes, Floats, Ints
from meshslam.perception import HEIGHT_PX, WIDTH_PX, Crop, cut_out
from meshslam.training.degrade import Seen, cut, obstructed, seen
from meshslam.training.scene import Picture

LEAST_SHOWN = 0.30  # of the car's own pixels
LEAST_PX = 22  # of the mask's box


@dataclass(frozen=True, eq=False)
class Sample:
    """A crop and what is true of it."""

    cut: Bytes  # (HEIGHT_PX, WIDTH_PX, 4): BGR and mask
    keypoints: Floats  # (12, 2), px of the input
    visible: Floats  # (12,), 0 or 1: hidden by nothing, and within the crop
    angle_rad: float
    box_px: tuple[float, float]  # width and height of the box about the car's seen pixels, in px of the input


@dataclass(frozen=True, eq=False)
class Samples:
    """Many samples as arrays."""

    cuts: Bytes  # (N, HEIGHT_PX, WIDTH_PX, 4)
    keypoints: Floats  # (N, 12, 2)
    visible: Floats  # (N, 12)
    angles_rad: Floats  # (N,)
    boxes_px: Floats  # (N, 2)

    def __len__(self) -> int:
        return len(self.cuts)

    def chosen(self, rows: Ints) -> Samples:
        """Copies of the samples with these numbers."""
        return Samples(*(part[rows] for part in vars(self).values()))


def taken(rng: np.random.Generator, picture: Picture) -> Sample | None:
    """Obstruct, cut, segment and photograph a picture; None if too little of the car is seen."""
    part = cut(rng, obstructed(rng, picture))
    return labelled(seen(rng, part), part) if enough_is_seen(part) else None


def enough_is_seen(picture: Picture) -> bool:
    """Whether what is left of the car can tell anything."""
    return bool(picture.mask.sum() >= LEAST_SHOWN * picture.whole_px and picture.visible.any())


def labelled(found: Seen, picture: Picture) -> Sample | None:
    """The crop about a detection with what is true of it; None if it is too small."""
    x, y, w, h = cv2.boundingRect(found.mask)
    if max(w, h) < LEAST_PX or min(w, h) < 6:
        return None
    crop = Crop.around((float(x), float(y), float(w), float(h)))
    size = cv2.boundingRect(picture.mask.astype(np.uint8))[2:] * crop.scale
    keypoints = crop.to_input(picture.keypoints)
    return Sample(
        cut_out(found.image_bgr, found.mask, crop),
        keypoints,
        (picture.visible & in_crop(keypoints)).astype(float),
        picture.viewing_angle_rad,
        (float(size[0]), float(size[1])),
    )


def in_crop(keypoints: Floats) -> Bools:
    """Which points (..., 2) px lie within the input."""
    inside: Bools = np.all((keypoints >= -0.5) & (keypoints <= [WIDTH_PX - 0.5, HEIGHT_PX - 0.5]), axis=-1)
    return inside


def gathered(samples: Sequence[Sample]) -> Samples:
    """Put samples together."""
    return Samples(
        np.stack([s.cut for s in samples]),
        np.stack([s.keypoints for s in samples]),
        np.stack([s.visible for s in samples]),
        np.array([s.angle_rad for s in samples]),
        np.array([s.box_px for s in samples]),
    )
