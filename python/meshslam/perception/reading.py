"""Read and check a detection file: what is wrong is named with its file, its annotation and its key."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from meshslam.errors import DetectionError
from meshslam.geometry import Floats
from meshslam.perception.detections import CategoryEntry, Detection, DetectionSet, ImageEntry
from meshslam.perception.keypoint_names import ours
from meshslam.perception.masks import is_finite_number, segmentation_problem
from meshslam.sequences import LEAST_ANGLES

Entry = TypeVar("Entry", ImageEntry, CategoryEntry, Detection)

SCORE_OF_VISIBILITY = {0: 0.0, 1: 0.5, 2: 0.95}  # COCO's v where no scores are given: labelled but hidden; seen


def read_detections(path: Path) -> DetectionSet:
    """Read a detection file as FORMATS.md describes it.

    A missing `score` is 1. Missing `keypoint_scores` follow from v: 0.95 for 2, 0.5 for 1, 0 for 0. Key points outside
    the image carry no information, confidences above 1 are 1: both are said in the set's `warnings`. Raises
    DetectionError for everything else that breaks the schema.
    """
    path = Path(path)
    root = _load(path)
    images = _entries(path, root, "images", _image)
    categories = _entries(path, root, "categories", _category)
    names = [c.name for c in categories]
    if len(set(names)) < len(names):
        raise DetectionError(f"{path}: categories: names must differ, found {names}")
    reader = _AnnotationReader({i.id: i for i in images}, {c.id: c for c in categories})
    detections = _entries(path, root, "annotations", reader.read)
    return DetectionSet(images, categories, detections, reader.warnings(path))


def _load(path: Path) -> dict[str, Any]:
    try:
        root = json.loads(path.read_bytes())
    except OSError as error:
        raise DetectionError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise DetectionError(f"{path}: is no JSON: {error}") from None
    if not isinstance(root, dict):
        raise DetectionError(f"{path}: found {_kind(root)}, expected an object with images, categories and annotations")
    return root


def _entries(path: Path, root: dict[str, Any], key: str, read: Callable[[dict[str, Any]], Entry]) -> tuple[Entry, ...]:
    """Read the list under `key`, each entry with its place in the message; ids must differ."""
    rows = root.get(key)
    if not isinstance(rows, list):
        found = f"found {_kind(rows)}" if key in root else "is missing"
        raise DetectionError(f"{path}: {key}: {found}, expected a list")
    entries: list[Entry] = []
    seen: set[int] = set()
    for index, row in enumerate(rows):
        name = f" (id {row['id']})" if isinstance(row, dict) and "id" in row else ""
        where = f"{path}: {key}[{index}]{name}"
        if not isinstance(row, dict):
            raise DetectionError(f"{where}: found {_kind(row)}, expected an object")
        try:
            entry = read(row)
        except DetectionError as error:
            raise DetectionError(f"{where}: {error}") from None
        if entry.id in seen:
            raise DetectionError(f"{where}: id: {entry.id} is used twice, expected one entry per id")
        seen.add(entry.id)
        entries.append(entry)
    return tuple(entries)


def _image(row: dict[str, Any]) -> ImageEntry:
    number = _integer(row, "id")
    width, height = _integer(row, "width"), _integer(row, "height")
    if min(width, height) < 1 or width * height > 10**9:
        raise DetectionError(f"width, height: found {width} x {height}, expected an image's size in pixels")
    return ImageEntry(number, _text(row, "file_name", f"{number:06d}.png"), width, height)


def _category(row: dict[str, Any]) -> CategoryEntry:
    given = row.get("keypoints") or []
    names = [ours(n) for n in given if isinstance(n, str)] if isinstance(given, list) else []
    if len(names) < len(given) or len(set(names)) < len(names):
        raise DetectionError("keypoints: expected a list of different names")
    return CategoryEntry(_integer(row, "id"), _text(row, "name"), tuple(names))


@dataclass
class _AnnotationReader:
    images: dict[int, ImageEntry]
    categories: dict[int, CategoryEntry]
    outside: list[int] = field(default_factory=list)  # annotation ids, one entry per key point
    above_one: list[int] = field(default_factory=list)

    def read(self, row: dict[str, Any]) -> Detection:
        number = _integer(row, "id")
        image = _known(row, "image_id", self.images, "images")
        category = _known(row, "category_id", self.categories, "categories")
        if "segmentation" not in row:
            raise DetectionError("segmentation: is missing, expected run lengths or polygons")
        problem = segmentation_problem(row["segmentation"], image.height, image.width)
        if problem:
            raise DetectionError(f"segmentation: {problem}")
        points, scores = self._keypoints(row, number, image, category)
        return Detection(
            id=number,
            frame=image.id,
            category=category.name,
            score=self._confidence(row.get("score", 1.0), "score", number),
            bbox=_box(row),
            segmentation=row["segmentation"],
            image_size=(image.height, image.width),
            keypoints=points,
            keypoint_scores=scores,
            keypoint_sigmas_px=None if scores is None else _positive(row, "keypoint_sigmas_px", len(scores)),
            viewing_angle_shares=_shares(row),
            track_id=_integer(row, "track_id") if row.get("track_id") is not None else None,
        )

    def _keypoints(
        self, row: dict[str, Any], number: int, image: ImageEntry, category: CategoryEntry
    ) -> tuple[Floats | None, Floats | None]:
        flat, count = row.get("keypoints"), len(category.keypoints)
        if flat is None or flat == []:
            return None, None
        if not isinstance(flat, list) or len(flat) != 3 * count:
            found = f"{len(flat)} numbers" if isinstance(flat, list) else _kind(flat)
            expected = f"3 x {count} (x, y, v of each of the {category.name}'s key points that `categories` names)"
            raise DetectionError(f"keypoints: found {found}, expected {expected}")
        visibility = [_visibility(v) for v in flat[2::3]]
        points = np.array([_coordinate(value, visibility[i // 2]) for i, value in enumerate(_without_v(flat))])
        points = points.reshape(count, 2)
        scores = self._keypoint_scores(row, number, visibility)
        inside = ((points >= -0.5) & (points <= np.array([image.width, image.height]) - 0.5)).all(1)
        self.outside += [number] * int((~inside & (scores > 0)).sum())
        return points, np.where(inside, scores, 0.0)

    def _keypoint_scores(self, row: dict[str, Any], number: int, visibility: list[int]) -> Floats:
        given = row.get("keypoint_scores")
        if given is None:
            return np.array([SCORE_OF_VISIBILITY[v] for v in visibility])
        if not isinstance(given, list) or len(given) != len(visibility):
            found = f"{len(given)} numbers" if isinstance(given, list) else _kind(given)
            raise DetectionError(f"keypoint_scores: found {found}, expected {len(visibility)}, one per key point")
        pairs = zip(given, visibility, strict=True)
        return np.array([self._confidence(s, "keypoint_scores", number) if v else 0.0 for s, v in pairs])

    def _confidence(self, value: object, key: str, number: int) -> float:
        score = _number(value, key)
        if score < 0:
            raise DetectionError(f"{key}: found {score}, expected a confidence between 0 and 1")
        if score > 1:
            self.above_one.append(number)
        return min(score, 1.0)

    def warnings(self, path: Path) -> tuple[str, ...]:
        """Sum up what was handled, one line a kind."""
        said = {
            "key points outside their image, taken as no information": self.outside,
            "confidences above 1, taken as 1": self.above_one,
        }
        return tuple(f"{path}: {what}: {len(ids)} (first: annotation {ids[0]})" for what, ids in said.items() if ids)


def _kind(value: object) -> str:
    names = {
        dict: "an object",
        list: "a list",
        str: "a string",
        bool: "true or false",
        int: "a number",
        float: "a number",
    }
    return names.get(type(value), "null")


def _integer(row: dict[str, Any], key: str) -> int:
    value = row.get(key)
    if key not in row:
        raise DetectionError(f"{key}: is missing, expected an integer")
    if type(value) is not int or value < 0:
        raise DetectionError(f"{key}: found {json.dumps(value)[:60]}, expected an integer that is not negative")
    return value


def _text(row: dict[str, Any], key: str, default: str | None = None) -> str:
    value = row.get(key, default)
    if not isinstance(value, str) or not value:
        raise DetectionError(f"{key}: {'found ' + _kind(value) if key in row else 'is missing'}, expected a name")
    return value


def _number(value: object, key: str) -> float:
    if not is_finite_number(value):
        raise DetectionError(f"{key}: found {json.dumps(value)[:60]}, expected a finite number")
    return float(value)


def _positive(row: dict[str, Any], key: str, count: int) -> Floats | None:
    given = row.get(key)
    if given is None:
        return None
    if not isinstance(given, list) or len(given) != count:
        raise DetectionError(f"{key}: expected {count} numbers, one per key point")
    values = np.array([_number(value, key) for value in given])
    if (values <= 0).any():
        raise DetectionError(f"{key}: found {values.min()}, expected pixels above 0")
    return values


def _shares(row: dict[str, Any]) -> Floats | None:
    """The distribution of the viewing angle, up to a factor."""
    key = "viewing_angle_shares"
    given = row.get(key)
    if given is None:
        return None
    if not isinstance(given, list) or len(given) < LEAST_ANGLES:
        raise DetectionError(f"{key}: expected a list of at least {LEAST_ANGLES} shares")
    values = np.array([_number(value, key) for value in given])
    if (values < 0).any() or values.sum() <= 0:
        raise DetectionError(f"{key}: expected shares that are not negative, and not all 0")
    return values


Value = TypeVar("Value", ImageEntry, CategoryEntry)


def _known(row: dict[str, Any], key: str, known: dict[int, Value], where: str) -> Value:
    number = _integer(row, key)
    if number not in known:
        raise DetectionError(f"{key}: found {number}, expected the id of an entry of `{where}`")
    return known[number]


def _box(row: dict[str, Any]) -> tuple[float, float, float, float]:
    value = row.get("bbox")
    if not isinstance(value, list) or len(value) != 4:
        found = "is missing" if "bbox" not in row else f"found {json.dumps(value)[:60]}"
        raise DetectionError(f"bbox: {found}, expected [x, y, width, height]")
    x, y, width, height = (_number(v, "bbox") for v in value)
    if min(width, height) < 0:
        raise DetectionError(f"bbox: found {value}, expected [x, y, width, height] with a size that is not negative")
    return x, y, width, height


def _visibility(value: object) -> int:
    if not is_finite_number(value) or value not in SCORE_OF_VISIBILITY:
        raise DetectionError(f"keypoints: found v = {json.dumps(value)[:60]}, expected 0, 1 or 2")
    return int(value)


def _without_v(flat: list[object]) -> list[object]:
    return [value for i, value in enumerate(flat) if i % 3 != 2]


def _coordinate(value: object, visibility: int) -> float:
    """Read a coordinate in pixels; where v = 0 it may be anything, and what is no number becomes 0."""
    if visibility == 0 and not is_finite_number(value):
        return 0.0
    return _number(value, "keypoints")
