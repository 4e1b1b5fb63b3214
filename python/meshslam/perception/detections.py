"""Detections of objects in images, and how they are written: the contract of docs/formats.md: detections.json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from io import BytesIO
from typing import Any

import numpy as np

from meshslam.errors import DetectionError
from meshslam.geometry import Bytes, Floats
from meshslam.perception.masks import Segmentation, decode_segmentation, encode_mask, segmentation_area_px


@dataclass(frozen=True)
class ImageEntry:
    """One frame of a detection set; `id` is the frame number."""

    id: int
    file_name: str
    width: int
    height: int


@dataclass(frozen=True)
class CategoryEntry:
    """A class of objects with the names of its key points, in the order of every detection's `keypoints`."""

    id: int
    name: str
    keypoints: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Detection:
    """One object seen in one image.

    `segmentation` is kept as it was read and written back untouched. A key point whose score is 0 carries no
    information, whatever its coordinates say.
    """

    id: int
    frame: int  # an image's id
    category: str
    score: float  # in [0, 1]
    bbox: tuple[float, float, float, float]  # x, y of the top-left corner, width, height: px
    segmentation: Segmentation
    image_size: tuple[int, int]  # height, width: px
    keypoints: Floats | None = None  # (K, 2) px
    keypoint_scores: Floats | None = None  # (K,) in [0, 1]
    track_id: int | None = None
    keypoint_sigmas_px: Floats | None = None  # (K,) along one axis; None: they follow from score and box
    viewing_angle_shares: Floats | None = (
        None  # (n,) of n equal bins around the object, the first about its front; up to a factor
    )

    @staticmethod
    def from_mask(
        mask: Bytes, *, id: int, frame: int, category: str = "car", score: float = 1.0, track_id: int | None = None
    ) -> Detection:
        """A detection from the mask (h, w) of a whole image, set above 0; DetectionError if no pixel is set.

        >>> mask = np.zeros((20, 30), np.uint8)
        >>> mask[5:10, 8:20] = 1
        >>> Detection.from_mask(mask, id=1, frame=0).bbox
        (8.0, 5.0, 12.0, 5.0)
        """
        pixels = (np.asarray(mask) > 0).astype(np.uint8)
        if pixels.ndim != 2 or not pixels.any():
            raise DetectionError(f"a mask is (h, w) with at least one pixel set, found shape {pixels.shape}, none set")
        rows, columns = (np.flatnonzero(pixels.any(axis=axis)) for axis in (1, 0))
        width, height = columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1
        box = (float(columns[0]), float(rows[0]), float(width), float(height))
        size = (pixels.shape[0], pixels.shape[1])
        return Detection(id, frame, category, score, box, encode_mask(pixels), size, track_id=track_id)

    def mask(self) -> Bytes:
        """Unpack the mask: (height, width), zeros and ones."""
        return decode_segmentation(self.segmentation, *self.image_size)

    @property
    def area_px(self) -> int:
        """The number of pixels of the mask."""
        return segmentation_area_px(self.segmentation, *self.image_size)

    def with_track(self, track_id: int | None) -> Detection:
        """Return the same detection under another track."""
        return replace(self, track_id=track_id)


@dataclass(frozen=True, eq=False)
class DetectionSet:
    """Every detection of a sequence. `warnings` says what was wrong in the file but could be handled."""

    images: tuple[ImageEntry, ...]
    categories: tuple[CategoryEntry, ...]
    detections: tuple[Detection, ...]
    warnings: tuple[str, ...] = ()
    undistorted: bool = False  # pixels are those of the pinhole view, though the recording's camera has a lens

    def by_frame(self) -> dict[int, tuple[Detection, ...]]:
        """Group the detections by image, the empty ones too, by ascending frame."""
        frames: dict[int, list[Detection]] = {i: [] for i in sorted(image.id for image in self.images)}
        for detection in self.detections:
            frames[detection.frame].append(detection)
        return {frame: tuple(found) for frame, found in frames.items()}

    def by_track(self) -> dict[int, tuple[Detection, ...]]:
        """Group the detections by track, by ascending frame; those without a track are left out."""
        tracks: dict[int, list[Detection]] = {}
        for detection in sorted(self.detections, key=lambda d: (d.frame, d.id)):
            if detection.track_id is not None:
                tracks.setdefault(detection.track_id, []).append(detection)
        return {track: tuple(tracks[track]) for track in sorted(tracks)}

    def keypoint_names(self, category: str) -> tuple[str, ...]:
        """Names of a category's key points; empty if it has none or is not in the file."""
        return next((c.keypoints for c in self.categories if c.name == category), ())

    def with_tracks(self, tracks: Mapping[int, int | None]) -> DetectionSet:
        """Put detections, by id, on tracks; those that `tracks` does not name stay as they are."""
        moved = tuple(d.with_track(tracks[d.id]) if d.id in tracks else d for d in self.detections)
        return replace(self, detections=moved)


def write_detections(detections: DetectionSet) -> bytes:
    """Return the file's bytes: one annotation a line, the same bytes for the same set."""
    numbers = {category.name: category.id for category in detections.categories}
    head: dict[str, Any] = ({"info": {"undistorted": True}} if detections.undistorted else {}) | {
        "images": [vars(image) for image in detections.images],
        "categories": [_category_entry(category) for category in detections.categories],
    }
    text = BytesIO()  # holds the file once
    text.write(f'{_dump(head)[:-1]}, "annotations": [\n'.encode())
    for k, detection in enumerate(detections.detections):
        row = _dump(_annotation(detection, numbers[detection.category]))
        text.write((",\n" if k else "").encode() + row.encode())
    text.write(b"\n]}\n")
    return text.getvalue()


def _dump(value: dict[str, Any]) -> str:
    return json.dumps(value, allow_nan=False, ensure_ascii=False)


def _category_entry(category: CategoryEntry) -> dict[str, Any]:
    entry: dict[str, Any] = {"id": category.id, "name": category.name}
    return entry | ({"keypoints": list(category.keypoints)} if category.keypoints else {})


def _annotation(detection: Detection, category_id: int) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "id": detection.id,
        "image_id": detection.frame,
        "category_id": category_id,
        "bbox": list(detection.bbox),
        "area": detection.area_px,
        "iscrowd": 0,
        "score": detection.score,
        "segmentation": detection.segmentation,
    }
    if detection.keypoints is not None and detection.keypoint_scores is not None:
        scores = detection.keypoint_scores.tolist()
        points = zip(detection.keypoints.tolist(), scores, strict=True)
        entry["keypoints"] = [value for (x, y), s in points for value in (x, y, 2 if s > 0 else 0)]
        entry["num_keypoints"] = sum(s > 0 for s in scores)
        entry["keypoint_scores"] = scores
        if detection.keypoint_sigmas_px is not None:
            entry["keypoint_sigmas_px"] = detection.keypoint_sigmas_px.tolist()
    if detection.viewing_angle_shares is not None:
        entry["viewing_angle_shares"] = detection.viewing_angle_shares.tolist()
    if detection.track_id is not None:
        entry["track_id"] = detection.track_id
    return entry
