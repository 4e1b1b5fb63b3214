"""Image features of a stream: points that are tracked from frame to frame, and the frames' images for the road."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np

from meshslam.errors import SequenceError
from meshslam.features.point_tracks import PointConfig, PointTracker, PointTracks, free_mask
from meshslam.geometry import Bytes, Floats
from meshslam.perception import Detection, grey

_BLUR_PX = 0.8
Held = TypeVar("Held")


@dataclass(frozen=True, eq=False)
class FrameImage:
    """One frame's brightness (h, w), a little blurred, and the mask (h, w) of what no detection shows."""

    image: Bytes
    free: Bytes


@dataclass(frozen=True, eq=False)
class FrameFeatures:
    """What one frame's image measures."""

    index: int  # of the frame
    image: FrameImage
    point_tracks: tuple[PointTracks, ...]


class FeatureTracker:
    """Looks at images in the order of their frames, which are counted from `first`."""

    def __init__(self, config: PointConfig, first: int = 0) -> None:
        self.trackers = [PointTracker(config, row, first) for row in range(config.rows)]
        self.next = first
        self._config = config

    def measure(self, image_bgr: Bytes, detections: Sequence[Detection]) -> FrameFeatures:
        """The features of the next frame's image (h, w, 3), outside of the detections."""
        free = free_mask(image_bgr.shape, detections, self._config)
        plain = cv2.GaussianBlur(cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY), (0, 0), _BLUR_PX)
        even = grey(image_bgr)
        image, tracks = FrameImage(np.asarray(plain, np.uint8), free), tuple(t.step(even, free) for t in self.trackers)
        self.next += 1
        return FrameFeatures(self.next - 1, image, tracks)


class ImageFeatures:
    """Holds what images measure, frame by frame; frames are counted from 0, and each is looked at once."""

    def __init__(self, config: PointConfig) -> None:
        self._tracker = FeatureTracker(config)
        self._tracks: dict[int, tuple[PointTracks, ...]] = {}
        self._images: dict[int, FrameImage] = {}

    def take(self, image_bgr: Bytes, detections: Sequence[Detection]) -> None:
        """The next frame's image (h, w, 3)."""
        self.put(self._tracker.measure(image_bgr, detections))

    def put(self, found: FrameFeatures) -> None:
        """What a tracker elsewhere has measured of a frame."""
        self._images[found.index], self._tracks[found.index] = found.image, found.point_tracks

    def point_tracks(self, index: int) -> tuple[PointTracks, ...]:
        """Point tracks up to a frame: those that are open, and those that have just ended."""
        return _held(self._tracks, index)

    def matches(self, index: int) -> Floats:
        """Points (n, 2, 2) px in the frame before and in this one."""
        return np.concatenate([tracks.matches for tracks in self.point_tracks(index)])

    def frame_image(self, index: int) -> FrameImage:
        """A frame's image."""
        return _held(self._images, index)

    def forget_before(self, index: int) -> None:
        """Let go of older frames."""
        self._images = {i: image for i, image in self._images.items() if i >= index}
        self._tracks = {i: tracks for i, tracks in self._tracks.items() if i >= index}

    def to_arrays(self) -> dict[str, Any]:
        """All that is held, as plain arrays; images as PNG."""
        arrays: dict[str, Any] = {
            "next": np.array(self._tracker.next),
            "images": np.array(list(self._images), np.int64),
        }
        for index, frame in self._images.items():
            arrays[f"image_{index}"] = _png(frame.image)
            arrays[f"free_{index}"] = _png(frame.free)
        for tracker in self._tracker.trackers:
            arrays |= {f"tracker_{tracker.row}_{k}": v for k, v in tracker.to_arrays().items()}
        return arrays

    def fill(self, arrays: Mapping[str, Any]) -> None:
        """The reverse of `to_arrays`."""
        self._tracker.next = int(arrays["next"])
        for index in arrays["images"].tolist():
            self._images[index] = FrameImage(_image(arrays[f"image_{index}"]), _image(arrays[f"free_{index}"]))
        for tracker in self._tracker.trackers:
            prefix = f"tracker_{tracker.row}_"
            tracker.fill({k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)})


def _held(of: Mapping[int, Held], index: int) -> Held:
    if index not in of:
        raise SequenceError(f"frame {index} of the stream came without an image: with images, every frame needs one")
    return of[index]


def _png(image: Bytes) -> Bytes:
    return np.asarray(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1], np.uint8)


def _image(png: Bytes) -> Bytes:
    return np.asarray(cv2.imdecode(png, cv2.IMREAD_GRAYSCALE), np.uint8)
