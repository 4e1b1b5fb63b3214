"""Instances in one image, and what of a network's candidates becomes one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from meshslam.geometry import Bools, Bytes, Floats
from meshslam.perception.coco import VEHICLE_GROUP, association_group
from meshslam.perception.suppression import Patch, outline_filled, share_out, shared_area_px, suppress_nested
from meshslam.settings import Settings, expert, public


@dataclass(frozen=True)
class SegmenterConfig(Settings):
    """What is kept of a network's answers."""

    score_threshold: float = public(0.3, low=0, high=1, doc="what the network is less confident of is dropped")
    iou_threshold: float = expert(0.6, low=0, high=1)  # boxes of one group that overlap by more are one object
    nested_share: float = expert(0.75, low=0, high=1)  # a mask with this share in another of its group is the same
    min_area_px: int = expert(80, low=1, unit="px²")
    max_instances: int = expert(100, low=1)
    zoom: float = public(2.0, low=1, doc="enlargement of a second look at the image's middle, for what is far; 1: none")
    max_side_px: int = expert(1280, low=32)  # of the input of networks that leave its size open


@dataclass(frozen=True, eq=False)
class Instance:
    """One object in one image."""

    name: str
    score: float
    bbox: tuple[float, float, float, float]  # of the mask: x, y, width, height: px
    mask: Bytes  # (height, width), zeros and ones
    keypoints: Floats | None = None  # (K, 2) px, by those who find them along the way
    keypoint_scores: Floats | None = None  # (K,)
    track_id: int | None = None  # by those who know one object from another


class Segmenter(Protocol):
    """Finds the instances in an image."""

    @property
    def names(self) -> tuple[str, ...]:
        """The classes that can be found."""
        ...

    @property
    def keypoint_names(self) -> tuple[str, ...]:
        """Names of the key points that come with every instance; mostly none do."""
        ...

    def segment(self, image_bgr: Bytes) -> list[Instance]:
        """Return the instances in a (height, width, 3) image by falling score; no pixel belongs to two."""
        ...


def settled(
    patches: Sequence[Patch], scores: Floats, names: Sequence[str], image_size: tuple[int, int], config: SegmenterConfig
) -> list[Instance]:
    """Instances of candidates by falling score: nested ones and passengers left out, each pixel given to one."""
    groups = np.array([association_group(name) for name in names])
    kept = suppress_nested(patches, groups, config.nested_share)
    kept = without_passengers(kept, patches, groups == VEHICLE_GROUP)
    masks = share_out([patches[k] for k in kept], [bool(groups[k] == VEHICLE_GROUP) for k in kept], *image_size)
    found = []
    for k, part in zip(kept, masks, strict=True):
        if int(part.sum()) < config.min_area_px:
            continue
        x, y, width, height = cv2.boundingRect(part)
        mask = np.zeros(image_size, np.uint8)
        mask[patches[k].place] = part
        bbox = (float(x + patches[k].left), float(y + patches[k].top), float(width), float(height))
        found.append(Instance(names[k], round(float(scores[k]), 4), bbox, mask))
    return found


def without_passengers(kept: Sequence[int], patches: Sequence[Patch], vehicle: Bools, share: float = 0.9) -> list[int]:
    """Drop of the `kept` patches those enclosed by a vehicle's outline: a driver leaves no hole in the car."""
    outlines = [
        Patch(v.left, v.top, outline_filled(v.inside.astype(np.uint8)).astype(np.float32))
        for v in (patches[k] for k in kept if vehicle[k])
    ]

    def enclosed(patch: Patch) -> bool:
        area = int(patch.inside.sum())
        return any(shared_area_px(patch, outline) >= share * area for outline in outlines)

    return [k for k in kept if vehicle[k] or not enclosed(patches[k])]


def first_line(error: Exception) -> str:
    """What an exception of another package says, in one line."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
