"""Instance masks as COCO writes them: run lengths (compressed or not) and polygons."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any, TypedDict, TypeGuard

import numpy as np
from pycocotools import mask as coco

from meshslam.errors import DetectionError
from meshslam.geometry import Bytes, Floats, Ints


class RunLengths(TypedDict):
    """COCO's run lengths.

    `size` is [height, width]; `counts` are runs of 0 and 1 in turn, column by column, packed (str) or plain (list).
    """

    size: list[int]
    counts: str | list[int]


Polygons = list[list[float]]  # each x0, y0, x1, y1, ... in pixels; their union is the mask
Segmentation = RunLengths | Polygons


def is_finite_number(value: object) -> TypeGuard[float]:
    """Tell whether a value read from JSON is a number that a float can hold."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def encode_mask(mask: Bytes) -> RunLengths:
    """Pack a (height, width) mask of zeros and ones."""
    code = coco.encode(np.asfortranarray(mask, dtype=np.uint8))
    return {"size": [int(s) for s in code["size"]], "counts": code["counts"].decode("ascii")}


def decode_segmentation(segmentation: Segmentation, height: int, width: int) -> Bytes:
    """Unpack a checked segmentation to a (height, width) mask of zeros and ones."""
    runs, mask = _runs(segmentation, height, width), np.zeros((height, width), np.uint8)
    ends = np.cumsum(runs)
    set_ends = ends[1::2][runs[1::2] > 0]
    if not len(set_ends):
        return mask
    first = int((ends[1::2] - runs[1::2])[runs[1::2] > 0][0]) // height  # column of the first pixel, and of the last
    last = (int(set_ends[-1]) - 1) // height
    inside: Ints = np.diff(np.clip(ends, first * height, (last + 1) * height), prepend=first * height).astype(np.int64)
    columns = np.repeat((np.arange(len(runs)) % 2).astype(np.uint8), inside)
    mask[:, first : last + 1] = columns.reshape(last + 1 - first, height).T
    return mask


def segmentation_area_px(segmentation: Segmentation, height: int, width: int) -> int:
    """Count the pixels of a checked segmentation without unpacking it."""
    return int(coco.area(_packed(segmentation, height, width)))


def segmentation_box(segmentation: Segmentation, height: int, width: int) -> tuple[float, float, float, float]:
    """The box of a checked segmentation's pixels: x, y, width, height, px; zeros where it has none."""
    x, y, w, h = coco.toBbox(_packed(segmentation, height, width)).tolist()
    return (x, y, w, h) if w > 0 and h > 0 else (0.0, 0.0, 0.0, 0.0)


def covered_shares(segmentations: Sequence[Segmentation], cover: Segmentation, height: int, width: int) -> Floats:
    """The share (n,) of each checked segmentation's pixels that lie in `cover`, of the same image; 0 without pixels."""
    packed = [_packed(s, height, width) for s in segmentations]
    shares = coco.iou(packed, [_packed(cover, height, width)], [1]) if packed else np.zeros((0, 1))
    found: Floats = np.nan_to_num(np.asarray(shares, float)[:, 0])
    return found


def _packed(segmentation: Segmentation, height: int, width: int) -> Any:  # noqa: ANN401 # as pycocotools takes it
    if isinstance(segmentation, list):
        return coco.merge(coco.frPyObjects(segmentation, height, width))
    code = {"size": [height, width], "counts": segmentation["counts"]}
    return code if isinstance(code["counts"], str) else coco.frPyObjects(code, height, width)


def _runs(segmentation: Segmentation, height: int, width: int) -> Ints:
    if isinstance(segmentation, list):
        counts = coco.merge(coco.frPyObjects(segmentation, height, width))["counts"].decode("ascii")
    else:
        counts = segmentation["counts"]
    runs = unpack_counts(counts) if isinstance(counts, str) else np.asarray(counts, np.int64)
    if runs is None:
        raise DetectionError(f"run lengths are damaged: {counts[:40]!r}")
    return runs


def segmentation_problem(segmentation: object, height: int, width: int) -> str | None:
    """Say in one clause what keeps a value read from JSON from being a mask of this image; None if nothing does."""
    if isinstance(segmentation, dict):
        return _run_length_problem(segmentation, height, width)
    if isinstance(segmentation, list):
        return _polygon_problem(segmentation, height, width)
    kind = type(segmentation).__name__
    return f"is {kind}, expected run lengths (an object with size and counts) or a list of polygons"


def _run_length_problem(code: dict[str, object], height: int, width: int) -> str | None:
    size, counts = code.get("size"), code.get("counts")
    if size != [height, width]:
        found = size if isinstance(size, list) and all(is_finite_number(s) for s in size) else type(size).__name__
        return f"has size {str(found)[:60]}, expected the image's [height, width] = [{height}, {width}]"
    if isinstance(counts, str):
        runs = unpack_counts(counts)
        if runs is None:
            return "has counts that are no packed run lengths (a damaged or cut string)"
    elif isinstance(counts, list) and all(type(c) is int and 0 <= c <= height * width for c in counts):
        runs = np.asarray(counts, np.int64)
    else:
        return f"has counts of type {type(counts).__name__}, expected a string or a list of run lengths"
    if len(runs) and (runs.min() < 0 or runs.max() > height * width):
        return f"has counts from {runs.min()} to {runs.max()}, expected {height} x {width} = {height * width} in all"
    if runs.sum() != height * width:
        return f"has counts that cover {runs.sum()} pixels, expected {height} x {width} = {height * width}"
    return None


def unpack_counts(counts: str) -> Ints | None:
    """Run lengths of COCO's packed string, None if it is damaged.

    Each number takes groups of 5 bits, least significant first, one character (48 + bits) a group; bit 5 says that more
    follow, bit 4 of the last is the sign. From the fourth number on it is the difference to the number two before.
    """
    if not counts.isascii():
        return None
    groups = np.frombuffer(counts.encode("ascii"), np.uint8).astype(np.int64) - 48
    last = (groups & 0x20) == 0
    if len(groups) == 0 or (groups < 0).any() or (groups > 63).any() or not last[-1]:
        return None
    number = np.concatenate([[0], np.cumsum(last)[:-1]])
    starts = np.concatenate([[0], np.flatnonzero(last)[:-1] + 1])
    place = 5 * (np.arange(len(groups)) - starts[number])
    if place.max() > 40:
        return None
    values = np.bincount(number, weights=(groups & 0x1F) << place).astype(np.int64)
    negative = (groups[last] & 0x10) != 0
    values[negative] -= np.int64(1) << (place[last][negative] + 5)
    runs = values.copy()
    runs[1::2] = np.cumsum(values[1::2])
    runs[2::2] = np.cumsum(values[2::2])
    return runs


def _polygon_problem(polygons: Sequence[object], height: int, width: int) -> str | None:
    if not polygons:
        return "is an empty list, expected at least one polygon (`meshslam convert coco` takes the box for the mask)"
    for number, polygon in enumerate(polygons):
        if not isinstance(polygon, list) or len(polygon) < 6 or len(polygon) % 2:
            return f"has a polygon {number} that is no list x0, y0, x1, y1, ... of at least three points"
        if not all(is_finite_number(v) for v in polygon):
            return f"has a polygon {number} with values that are no finite numbers"
        xs, ys = np.array(polygon[0::2], float), np.array(polygon[1::2], float)
        if min(xs.min() + width, ys.min() + height) < 0 or xs.max() > 2 * width or ys.max() > 2 * height:
            return f"has a polygon {number} that lies far outside the image of {width}x{height} pixels"
    return None
