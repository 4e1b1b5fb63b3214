"""Point tracks: corners of the static scene, followed by optical flow forwards and backwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from meshslam.geometry import Bools, Bytes, Floats
from meshslam.perception import Detection, corners, follow
from meshslam.settings import Settings, expert, public


@dataclass(frozen=True)
class PointConfig(Settings):
    """Corners as factors of the graph."""

    enabled: bool = public(True, doc="follow corners of the static scene, where there are images")
    corners: int = expert(160, low=1)  # that a block of frames begins with
    steps: int = expert(6, low=1)  # from frame to frame in a block; the next one begins with its last frame
    rows: int = expert(2, low=1)  # of blocks, staggered: where they overlap they hand on the scale
    min_frames: int = expert(3, low=2)  # of a track that is used
    agreement_px: float = expert(0.7, above=0)  # between where a corner was and where it comes back to
    mask_margin_px: int = expert(5, low=0)  # around detections: what moves is mostly detected
    edge_px: int = expert(8, low=0)  # of the image, where no corner is followed
    sigma_px: float = expert(0.7, above=0)
    kernel: float = expert(2.0, above=0)  # Geman and McClure's threshold, in sigmas


@dataclass(frozen=True, eq=False)
class PointTracks:
    """Points tracked over consecutive frames: all begin in the first of them, some end early."""

    row: int
    first: int  # index of the frame
    tracks: tuple[Floats, ...]  # each (n, m, 2) px: n corners seen in the first m frames and in no more
    is_closed: bool  # whether its last frame is the next block's first
    matches: Floats  # (n, 2, 2) px: corners in the frame before and in this one

    @property
    def last(self) -> int:
        """Index of the last frame that a track of it sees."""
        return self.first + max((t.shape[1] for t in self.tracks), default=1) - 1


@dataclass
class PointTracker:
    """Takes images in order; returns the point tracks of the open stretch of frames, or of the one that just ended.

    Stretches of several rows are staggered: the first one of row k of n is shortened by k/n.
    """

    config: PointConfig
    row: int = 0
    begins: int = 0  # index of the first frame
    _image: Bytes | None = None
    _index: int = field(init=False)
    _first: int = field(init=False)
    _pixels: Floats = field(default_factory=lambda: np.zeros((0, 1, 2)))  # of the corners that are still followed
    _ended: list[Floats] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._index, self._first = self.begins - 1, self.begins

    def step(self, image: Bytes, free: Bytes) -> PointTracks:
        """Take the next frame's image (h, w), evened out as by `grey`, and the mask of what is static."""
        config = self.config
        self._index += 1
        if self._image is not None:
            self._follow(self._image, image, free)
        self._image = image
        tracks = tuple(t for t in (*self._ended, self._pixels) if len(t) and t.shape[1] >= config.min_frames)
        stagger = config.steps * self.row // config.rows
        early = self._first == self.begins and self._index - self.begins == stagger > 0
        closed = early or self._index - self._first >= config.steps
        block = PointTracks(self.row, self._first, tracks, closed, self._pixels[:, -2:])
        if closed or self._index == self.begins:
            self._first, self._ended = self._index, []
            self._pixels = _new_corners(image, free, config.corners)[:, None]
        return block

    def to_arrays(self) -> dict[str, Any]:
        """All that is held, as plain arrays."""
        assert self._image is not None
        ended = [row for tracks in self._ended for row in tracks]
        return {
            "image": self._image,
            "index": np.array([self._index, self._first]),
            "pixels": self._pixels,
            "ended_lengths": np.array([tracks.shape[:2] for tracks in self._ended], np.int64).reshape(-1, 2),
            "ended": np.concatenate([np.zeros((0, 2)), *ended]),
        }

    def fill(self, arrays: Mapping[str, Any]) -> None:
        """The reverse of `to_arrays`."""
        self._image = np.asarray(arrays["image"], np.uint8)
        self._index, self._first = (int(i) for i in arrays["index"])
        self._pixels = np.asarray(arrays["pixels"], float)
        at, self._ended = 0, []
        for count, length in arrays["ended_lengths"].tolist():
            self._ended.append(np.asarray(arrays["ended"][at : at + count * length], float).reshape(count, length, 2))
            at += count * length

    def _follow(self, before: Bytes, image: Bytes, free: Bytes) -> None:
        flow = follow(before, image, self._pixels[:, -1], self.config.agreement_px)
        good = flow.good & _on(free, flow.points)
        self._ended.append(self._pixels[~good])
        self._pixels = np.concatenate([self._pixels[good], flow.points[good, None]], axis=1)


def _new_corners(image: Bytes, free: Bytes, count: int) -> Floats:
    """Corners (n, 2), as many in the lower half as in the upper: the road's are weak."""
    middle, found = image.shape[0] // 2, []
    for half in (slice(0, middle), slice(middle, None)):
        mask = np.zeros_like(free)
        mask[half] = free[half]
        found.append(corners(image, mask, 0, 0, count // 2))
    return np.concatenate(found)


def free_mask(shape: tuple[int, ...], detections: Sequence[Detection], config: PointConfig) -> Bytes:
    """Mask (h, w) outside of all detections and of the image's edge."""
    taken = np.zeros(shape[:2], np.uint8)
    for detection in detections:
        taken |= detection.mask()
    size, edge = 2 * config.mask_margin_px + 1, config.edge_px
    taken = np.asarray(cv2.dilate(taken, np.ones((size, size), np.uint8)), np.uint8)
    free = np.zeros_like(taken)
    free[edge:-edge, edge:-edge] = taken[edge:-edge, edge:-edge] == 0
    return free


def _on(mask: Bytes, points: Floats) -> Bools:
    """Which points (n, 2) lie on a mask (h, w)."""
    at = np.round(points).astype(int)
    inside = np.asarray(((at >= 0) & (at < [mask.shape[1], mask.shape[0]])).all(1), bool)
    inside[inside] = mask[at[inside, 1], at[inside, 0]] > 0
    return inside
