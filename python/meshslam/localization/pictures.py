"""A recording's images as SLAM looks at them: corners that are followed, and the road."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from meshslam.geometry.arrays import Bytes, Floats
from meshslam.localization.point_tracks import PointBlock, PointConfig, PointTracker, free_mask
from meshslam.perception import Detection, DetectionSet
from meshslam.perception.flow import grey
from meshslam.sequences import Sequence

_KEPT = 64  # frames whose images are held
_BLUR_PX = 0.8


@dataclass(frozen=True, eq=False)
class Picture:
    """One frame's brightness (h, w), a little blurred, and the mask (h, w) of what no detection shows."""

    image: Bytes
    free: Bytes


@dataclass
class Pictures:
    """By a frame's index: its picture, and the blocks of corners that it opens, goes on with or closes.

    Corners are followed once, whoever asks and how often.
    """

    sequence: Sequence
    detections_of_frame: dict[int, tuple[Detection, ...]]
    config: PointConfig
    _blocks: list[tuple[PointBlock, ...]] = field(default_factory=list)
    _held: dict[int, Picture] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._trackers = [PointTracker(self.config, row) for row in range(self.config.rows)]

    def blocks(self, index: int) -> tuple[PointBlock, ...]:
        """Corners up to a frame, one block of each row."""
        while len(self._blocks) <= index:
            at = len(self._blocks)
            image = self.sequence.read_image(at)
            free = self._free(at)
            self._hold(at, image, free)
            even = grey(image)
            self._blocks.append(tuple(tracker.step(even, free) for tracker in self._trackers))
        return self._blocks[index]

    def matches(self, index: int) -> Floats:
        """Corners (n, 2, 2) px in the frame before and in this one."""
        return np.concatenate([block.matches for block in self.blocks(index)])

    def picture(self, index: int) -> Picture:
        """A frame's picture."""
        if index not in self._held:
            self._hold(index, self.sequence.read_image(index), self._free(index))
        return self._held[index]

    def _hold(self, index: int, image_bgr: Bytes, free: Bytes) -> None:
        plain = cv2.GaussianBlur(cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY), (0, 0), _BLUR_PX)
        self._held[index] = Picture(np.asarray(plain, np.uint8), free)
        while len(self._held) > _KEPT:
            del self._held[next(iter(self._held))]

    def _free(self, index: int) -> Bytes:
        camera = self.sequence.camera
        detections = self.detections_of_frame.get(self.sequence.frame_ids[index], ())
        return free_mask((camera.height, camera.width), detections, self.config)


def pictures_of(sequence: Sequence, detections: DetectionSet, config: PointConfig) -> Pictures | None:
    """The recording's pictures; None where it has none."""
    return Pictures(sequence, detections.by_frame(), config) if sequence.image_paths is not None else None
