"""Schema of a COCO detection file, checked on the JSON alone so that every problem can be listed."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, TypeGuard

from meshslam.sequences.report import Report, fail
from meshslam.sequences.sequence import Sequence
from meshslam.sequences.text import read_text

LEAST_ANGLES = 4  # bins of a viewing angle's distribution


def check_detections(path: Path, sequence: Sequence | None, report: Report) -> None:
    """Report everything in a detection file that does not fit the schema, or the sequence's frames and image size."""
    document = report.attempt(lambda: _document(path))
    if document is None:
        return
    lists = {key: _entries(path, document, key, report) for key in ("images", "categories", "annotations")}
    images = _identified(path, "images", lists["images"], report)
    if sequence is not None:
        _check_frames(path, images, sequence, report)
    categories = _identified(path, "categories", lists["categories"], report)
    for number, entry in categories.items():
        if not isinstance(entry.get("name"), str):
            report.add(path, f"categories id {number}", "has no name")
    size = None if sequence is None else (sequence.raw_camera.width, sequence.raw_camera.height)
    for number, annotation in _identified(path, "annotations", lists["annotations"], report).items():
        where = f"annotations id {number}"
        if lists["images"] and annotation.get("image_id") not in images:
            report.add(path, where, f"image_id {annotation.get('image_id')!r} is not in images")
        category = categories.get(annotation.get("category_id"), None)
        if lists["categories"] and category is None:
            report.add(path, where, f"category_id {annotation.get('category_id')!r} is not in categories")
        for what in _annotation_problems(annotation, category, size):
            report.add(path, where, what)


def _check_frames(path: Path, images: dict[Any, dict[str, Any]], sequence: Sequence, report: Report) -> None:
    frames, raw = set(sequence.frame_ids), sequence.raw_camera
    span = f"{sequence.frame_ids[0]} to {sequence.frame_ids[-1]}"
    for number, image in images.items():
        if number not in frames:
            report.add(path, f"images id {number}", f"no frame of that number; frames are {span}")
        size = (image.get("width", raw.width), image.get("height", raw.height))
        if size != (raw.width, raw.height):
            report.add(path, f"images id {number}", f"is {size[0]}x{size[1]}, the camera's is {raw.width}x{raw.height}")


def _document(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise fail(path, f"line {error.lineno}", f"not valid JSON: {error.msg}") from None
    except ValueError:
        raise fail(path, "", "not valid JSON: a number of thousands of digits") from None
    except RecursionError:
        raise fail(path, "", "not valid JSON: nested too deeply") from None
    if not isinstance(document, dict):
        raise fail(path, "", "expected an object with images, categories, annotations")
    return document


def _entries(path: Path, document: dict[str, Any], key: str, report: Report) -> list[dict[str, Any]]:
    value = document.get(key)
    if not isinstance(value, list):
        report.add(path, key, "key is missing, expected a list" if value is None else "expected a list")
        return []
    for i, entry in enumerate(value):
        if not isinstance(entry, dict):
            report.add(path, f"{key}[{i}]", "expected an object")
    return [entry for entry in value if isinstance(entry, dict)]


def _identified(path: Path, key: str, entries: list[dict[str, Any]], report: Report) -> dict[Any, dict[str, Any]]:
    found: dict[Any, dict[str, Any]] = {}
    for i, entry in enumerate(entries):
        number = entry.get("id")
        if not isinstance(number, int) or isinstance(number, bool):
            report.add(path, f"{key}[{i}]", f"id {number!r} is no whole number")
        elif number in found:
            report.add(path, f"{key}[{i}]", f"id {number} comes twice")
        else:
            found[number] = entry
    return found


def _annotation_problems(
    annotation: dict[str, Any], category: dict[str, Any] | None, size: tuple[int, int] | None
) -> list[str]:
    found = [_box_problem(annotation.get("bbox")), _mask_problem(annotation.get("segmentation"), size)]
    count = None if category is None else len(category.get("keypoints") or [])
    found += _keypoint_problems(annotation, count)
    found.append(_shares_problem(annotation.get("viewing_angle_shares")))
    score, track = annotation.get("score", 1.0), annotation.get("track_id")
    if not _is_number(score) or not 0 <= score <= 1:
        found.append(f"score {score!r} is no number from 0 to 1")
    if track is not None and (not isinstance(track, int) or isinstance(track, bool)):
        found.append(f"track_id {track!r} is no whole number")
    return [problem for problem in found if problem]


def _keypoint_problems(annotation: dict[str, Any], count: int | None) -> list[str]:
    points = annotation.get("keypoints")
    if isinstance(points, list):
        points = _without_unknown(points)
        if any(v not in (0, 1, 2) for v in points[2::3]):
            return ["keypoints: v of each x, y, v is 0, 1 or 2"]
    found = [_list_problem("keypoints", points, None if count is None else 3 * count)]
    for key, least in (("keypoint_scores", "0 or more"), ("keypoint_sigmas_px", "above 0")):
        values = annotation.get(key)
        found.append(_list_problem(key, values, count))
        if _are_numbers(values) and any(value < 0 or (value == 0 and least == "above 0") for value in values):
            found.append(f"{key} holds {min(values)}, expected numbers {least}")
    return found


def _without_unknown(points: list[Any]) -> list[Any]:
    """x, y, v of each point; x and y are 0 where v = 0, whatever stood there."""
    return [0 if i % 3 < 2 and points[i - i % 3 + 2 : i - i % 3 + 3] == [0] else p for i, p in enumerate(points)]


def _shares_problem(shares: object) -> str:
    if shares is None:
        return ""
    good = _are_numbers(shares) and len(shares) >= LEAST_ANGLES and min(shares) >= 0 and sum(shares) > 0
    return "" if good else f"viewing_angle_shares: expected {LEAST_ANGLES} or more numbers, none negative, not all 0"


def _box_problem(box: object) -> str:
    if not _are_numbers(box) or len(box) != 4:
        return f"bbox {box!r} is not four finite numbers x, y, w, h"
    return "" if box[2] > 0 and box[3] > 0 else f"bbox {box!r} has no area"


def _list_problem(key: str, values: object, expected: int | None) -> str:
    if values is None:
        return ""
    if not _are_numbers(values):
        return f"{key} are not finite numbers"
    return (
        ""
        if expected is None or len(values) == expected
        else f"{key} holds {len(values)} numbers, expected {expected} by its category"
    )


def _mask_problem(mask: object, size: tuple[int, int] | None) -> str:
    """RLE (compressed or not) or polygons."""
    if mask is None:
        return "segmentation is missing, expected RLE (size, counts) or polygons"
    if isinstance(mask, list):
        good = all(_are_numbers(part) and len(part) >= 6 and len(part) % 2 == 0 for part in mask) and len(mask) > 0
        return "" if good else "segmentation: a polygon is a list of at least three x, y pairs"
    if not isinstance(mask, dict) or not isinstance(mask.get("counts"), str | list):
        return "segmentation is neither RLE (size, counts) nor polygons"
    found = mask.get("size")
    if not (_are_numbers(found) and len(found) == 2) or (size is not None and found != [size[1], size[0]]):
        expected = "" if size is None else f", the image's is {[size[1], size[0]]}"
        return f"segmentation: RLE of size {found} (h, w){expected}"
    counts = mask["counts"]
    runs = _unpack(counts) if isinstance(counts, str) else counts
    good = all(isinstance(n, int) and n >= 0 for n in runs) and sum(runs) == found[0] * found[1]
    return "" if good else "segmentation: RLE counts do not add up to the image"


def _unpack(counts: str) -> list[int]:
    """Return run lengths; [-1] for text that is none.

    COCO packs six bits a character, five of the number and one that says that more follow; from the third run on it is
    the difference to the run before the last.
    """
    runs: list[int] = []
    value = shift = 0
    for character in counts:
        code = ord(character) - 48
        if not 0 <= code < 64:
            return [-1]
        value |= (code & 31) << shift
        shift += 5
        if code & 32:
            continue
        if code & 16:
            value -= 1 << shift
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
        value = shift = 0
    return [-1] if shift else runs


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _are_numbers(values: object) -> TypeGuard[list[float]]:
    return isinstance(values, list) and all(_is_number(value) for value in values)
