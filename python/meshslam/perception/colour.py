"""Masks and key points read back from the colours of a simulated world: `--segmenter colour`."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from meshslam.categories import load_category
from meshslam.geometry import Bools, Bytes, Floats, Ints
from meshslam.perception.colour_code import read_colours
from meshslam.perception.instances import Instance
from meshslam.settings import Settings, expert

COLOUR = "colour"  # what --segmenter takes


@dataclass(frozen=True)
class ColourConfig(Settings):
    """What is kept of what the colours say."""

    category: str = expert("car")  # what the bodies are
    identities: bool = expert(False)  # the colour of a body is its track id: for worlds in which no two have the same
    min_area_px: int = expert(80, low=1, unit="px²")
    min_point_px: int = expert(3, low=1, unit="px²")  # of a key point's mark
    min_ring: float = expert(0.6, low=0, high=1)  # of the pixels around a mark show its body; else a part is hidden
    max_gap: float = expert(0.6, low=0)  # between parts of one body, in heights of the larger


@dataclass(frozen=True, eq=False)
class _Body:
    """One body in an image."""

    hue: int
    mask: Bools  # (h, w)


class ColourSegmenter:
    """Finds bodies by pale hues and their key points by full ones (see `colour_code`)."""

    def __init__(self, config: ColourConfig | None = None) -> None:
        self.config = config or ColourConfig()
        self.names = (self.config.category,)
        self.keypoint_names = load_category(self.config.category).keypoint_names

    def segment(self, image_bgr: Bytes) -> list[Instance]:
        """Return the bodies in a (height, width, 3) image, the largest first."""
        hue, bodies, points = read_colours(image_bgr)
        marks = _marks(hue, points, self.config.min_point_px)
        owner = _owner(hue, bodies, points, marks)
        found = [
            _Body(int(number), part)
            for number in np.unique(owner[owner >= 0])
            for part in _parts(owner == number, self.config)
        ]
        found.sort(key=lambda body: -int(body.mask.sum()))
        return [self._instance(body, hue, owner, marks) for body in found]

    def _instance(self, body: _Body, hue: Ints, owner: Ints, marks: Ints) -> Instance:
        pixels, scores = np.zeros((len(self.keypoint_names), 2)), np.zeros(len(self.keypoint_names))
        inside = np.where(body.mask, marks, 0)
        for number in np.unique(inside[inside > 0]):
            rows, columns = np.nonzero(inside == number)
            index = int(hue[rows[0], columns[0]])
            whole = _ring_share(rows, columns, owner == body.hue) >= self.config.min_ring
            if index < len(scores) and scores[index] == 0 and whole:
                pixels[index], scores[index] = [columns.mean(), rows.mean()], 1.0
        mask = body.mask.astype(np.uint8)
        x, y, w, h = cv2.boundingRect(mask)
        box = (float(x), float(y), float(w), float(h))
        track = body.hue + 1 if self.config.identities else None
        return Instance(self.config.category, 1.0, box, mask, pixels.round(3), scores, track)


def _marks(hue: Ints, points: Bools, least_px: int) -> Ints:
    """Numbers (h, w) of the key points' marks from 1 on, 0 where there is none: connected pixels of one hue."""
    from scipy import ndimage  # slow to import

    numbers = np.zeros(hue.shape, np.int64)
    for index in np.unique(hue[points]):
        labels, count = ndimage.label(points & (hue == index), np.ones((3, 3)))
        sizes = np.bincount(labels.ravel(), minlength=count + 1)
        large = (sizes >= least_px) & (np.arange(count + 1) > 0)
        names = np.where(large, numbers.max() + np.cumsum(large), 0)
        numbers = np.where(labels > 0, names[labels], numbers)
    return numbers


def _owner(hue: Ints, bodies: Bools, points: Bools, marks: Ints) -> Ints:
    """The hue of the body that each pixel belongs to, -1 for none; a mark belongs to the body that is around it."""
    from scipy import ndimage  # slow to import

    owner = np.where(bodies, hue, -1)
    if not bodies.any() or not points.any():
        return owner
    rows, columns = ndimage.distance_transform_edt(~bodies, return_distances=False, return_indices=True)
    nearest = hue[rows, columns]
    owner[points] = nearest[points]
    for number in np.unique(marks[marks > 0]):
        mark = marks == number
        owner[mark] = np.bincount(nearest[mark]).argmax()
    return owner


def _ring_share(rows: Ints, columns: Ints, body: Bools) -> float:
    """The share of the pixels around a mark (n,) that show a body (h, w)."""
    from scipy import ndimage  # slow to import

    y, x = rows - rows.min() + 1, columns - columns.min() + 1
    mark = np.zeros((y.max() + 2, x.max() + 2), bool)
    mark[y, x] = True
    ring_y, ring_x = np.nonzero(ndimage.binary_dilation(mark, np.ones((3, 3), bool)) & ~mark)
    at_y, at_x = ring_y + rows.min() - 1, ring_x + columns.min() - 1
    inside = (at_y >= 0) & (at_y < body.shape[0]) & (at_x >= 0) & (at_x < body.shape[1])
    return float(body[at_y[inside], at_x[inside]].sum() / len(ring_y))


def _parts(mask: Bools, config: ColourConfig) -> list[Bools]:
    """The bodies of one hue: what lies near together is one that something stands before."""
    from scipy import ndimage  # slow to import

    labels, count = ndimage.label(mask, np.ones((3, 3)))
    boxes = [np.array([[x.start, y.start], [x.stop, y.stop]], float) for y, x in ndimage.find_objects(labels)]
    groups = list(range(count))
    for i in range(count):
        for j in range(i):
            if _gap(boxes[i], boxes[j]) <= config.max_gap * max(np.ptp(boxes[i][:, 1]), np.ptp(boxes[j][:, 1])):
                groups = [groups[j] if g == groups[i] else g for g in groups]
    merged = [np.isin(labels, 1 + np.flatnonzero(np.array(groups) == g)) for g in sorted(set(groups))]
    return [part for part in merged if part.sum() >= config.min_area_px]


def _gap(a: Floats, b: Floats) -> float:
    """Pixels between two boxes ((x0, y0), (x1, y1)); 0 if they meet."""
    return float(np.maximum(np.maximum(a[0] - b[1], b[0] - a[1]), 0.0).max())
