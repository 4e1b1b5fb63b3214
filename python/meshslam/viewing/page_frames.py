"""Frames of a run for its page: reduced images, and what was detected as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from meshslam.geometry import AnyArray, Bytes, Floats
from meshslam.perception import Detection
from meshslam.viewing.context import ReportContext
from meshslam.viewing.markup import jpeg_base64, packed
from meshslam.viewing.overlay import mask_contours, visible_keypoints

WORKERS = 2  # threads; each holds one frame
WIDEST_PX = 1280
NARROWEST_PX = 320
IMAGES_BYTES = 12_000_000  # of all images together, about: a third more as base64
QUALITIES = (80, 65, 50, 35, 20)  # of JPEG, the first that fits the frame's share
SLACK = 1.25  # of a frame's share
CONTOUR_TOLERANCE_PX = 0.7
MASK_FRAMES = 4000  # without images


@dataclass(frozen=True, eq=False)
class PageFrame:
    """One frame as the page has it."""

    index: int
    image: str | None  # JPEG in base64
    detections: list[dict[str, Any]]
    borders: list[AnyArray]  # (n, 2) int16, px, of all detections one after the other


def shown_frames(context: ReportContext) -> list[int]:
    """Indices of the page's frames: all of them, or spread evenly where they are too many."""
    count = len(context.frame_ids)
    most = MASK_FRAMES if context.read_image is None else max(2, context.frames_in_report)
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist() if count else []


def page_frames(context: ReportContext, indices: Sequence[int]) -> list[PageFrame]:
    """Read each image once, a few at a time."""
    share = IMAGES_BYTES // max(1, len(indices))
    width = _image_width(context, indices, share)
    frames = []
    with ThreadPoolExecutor(WORKERS) as workers:
        for frame in workers.map(lambda index: _frame(context, index, width, share), indices):
            frames.append(frame)
            if context.progress is not None:
                context.progress(len(frames), len(indices))
    return frames


def frames_data(context: ReportContext, frames: Sequence[PageFrame], origin: Floats) -> dict[str, Any]:
    """What the page's script knows of the frames; poses (n, 12) are rows of world_from_camera less `origin`."""
    poses = [context.world_from_camera[frame.index] for frame in frames]
    rows = [np.column_stack([p.rotation, p.translation - origin]).ravel() for p in poses]
    borders = [border for frame in frames for border in frame.borders]
    points = np.concatenate([np.zeros((0, 2), np.int16), *borders])
    return {
        "ids": [context.frame_ids[frame.index] for frame in frames],
        "indices": [frame.index for frame in frames],
        "images": frames[0].image is not None if frames else False,
        "poses": packed(np.array(rows, np.float32).reshape(-1, 12)),
        "detections": [frame.detections for frame in frames],
        "border_lengths": packed(np.array([len(border) for border in borders], np.uint16)),
        "border_points": packed(points),
    }


def _frame(context: ReportContext, index: int, width: int, share: int) -> PageFrame:
    image = None if context.read_image is None else context.read_image(index)
    detections, borders = [], []
    for detection in context.found_at(index):
        outline = _borders(detection)
        detections.append(_described(detection, len(outline)))
        borders += outline
    return PageFrame(index, None if image is None else _packed_image(_sized(image, width), share), detections, borders)


def _described(detection: Detection, borders: int) -> dict[str, Any]:
    """A detection's numbers; `borders`: how many of the page's borders are its own."""
    found: dict[str, Any] = {
        "category": detection.category,
        "score": round(detection.score, 3),
        "box": [round(v, 1) for v in detection.bbox],
        "borders": borders,
    }
    if detection.track_id is not None:
        found["track"] = detection.track_id
    points = [[i, round(x, 1), round(y, 1)] for i, (x, y) in visible_keypoints(detection)]
    return found | ({"points": points} if points else {})


def _borders(detection: Detection) -> list[AnyArray]:
    """Borders of a mask, thinned; filled by the even-odd rule they are the mask again."""
    mask = detection.mask()
    left, top, width, height = detection.bbox
    x, y = max(0, int(left) - 2), max(0, int(top) - 2)
    part = np.ascontiguousarray(mask[y : int(top + height) + 3, x : int(left + width) + 3])
    found = mask_contours(part)
    thin = [cv2.approxPolyDP(c.astype(np.float32)[:, None], CONTOUR_TOLERANCE_PX, True)[:, 0] for c in found]
    return [(c + (x, y)).astype(np.int16) for c in thin if len(c) > 2]


def _image_width(context: ReportContext, indices: Sequence[int], share: int) -> int:
    """Width of all images, from what the middle one needs."""
    widest = min(WIDEST_PX, context.camera.width)
    if context.read_image is None or not indices:
        return widest
    image = _sized(context.read_image(indices[len(indices) // 2]), widest)
    needed = 0.75 * len(jpeg_base64(image, QUALITIES[0]))
    fitting = int(widest * min(1.0, share / needed) ** 0.6)  # a small image takes more bytes a pixel
    return min(widest, max(NARROWEST_PX, fitting))


def _sized(image: Bytes, width: int) -> Bytes:
    if image.shape[1] == width:
        return image
    size = width, max(1, round(image.shape[0] * width / image.shape[1]))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _packed_image(image: Bytes, share: int) -> str:
    grey = np.array_equal(image[::8, ::8, 0], image[::8, ::8, 2]) and np.array_equal(image[..., 0], image[..., 2])
    kept = np.ascontiguousarray(image[..., 0]) if grey else image
    tried = ""
    for quality in QUALITIES:
        tried = jpeg_base64(kept, quality)
        if 0.75 * len(tried) <= SLACK * share:
            break
    return tried
