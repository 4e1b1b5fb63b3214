"""COCO documents as labelling tools write them: brought to the contract, then read as any detection file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshslam.perception.conversion.frames import LARGEST_DIGITS, ImageFrames
from meshslam.perception.conversion.videos import without_videos
from meshslam.perception.detections import DetectionSet
from meshslam.perception.faults import Faults
from meshslam.perception.json_values import quoted
from meshslam.perception.masks import is_finite_number
from meshslam.perception.reading import read_recorded_detections
from meshslam.sequences import Sequence

Row = dict[str, Any]
_HASHED = (  # what services make of a file's name
    (re.compile(r"(.+)_(png|jpe?g|bmp|webp|tiff?)\.rf\.[0-9A-Za-z]+\.\w+"), r"\1.\2"),  # Roboflow
    (re.compile(r"[0-9a-f]{8}-(.+\.\w+)"), r"\1"),  # Label Studio
)


def from_coco(
    path: Path,
    recording: Sequence,
    frames: ImageFrames,
    names: Mapping[int, str] | None = None,
    video: str | None = None,
) -> DetectionSet:
    """Read a COCO document by CVAT, datumaro, Label Studio, Roboflow, supervision, labelme2coco, sahi or TAO.

    `names` outrank those of its `categories`, by their ids. `video` is the one of several that the recording is. Where
    there is no mask the box becomes it. What is changed is said in the set's `warnings`. DetectionError names the place
    that is wrong.
    """
    prepare = _Dialect(frames, names, video).plain
    return read_recorded_detections(path, recording, None, prepare=prepare)


@dataclass(frozen=True)
class _Dialect:
    frames: ImageFrames
    names: Mapping[int, str] | None
    video: str | None

    def plain(self, root: Row, faults: Faults) -> Row:
        """The document as the contract has it; what is damaged stays as it is, for the reader to name."""
        root = without_videos(root, self.video, faults)
        rows = {key: _objects(root.get(key)) for key in ("images", "categories", "annotations")}
        if any(found is None for found in rows.values()):
            return root
        images, categories, annotations = (found or [] for found in rows.values())
        if self.names is not None:
            categories = [c | self._name_of(c) for c in categories]
        used = {a["category_id"] for a in annotations if type(a.get("category_id")) is int}
        found = {
            "images": _named(images, self.frames, faults),
            "categories": _without_doubles(categories, used),
            "annotations": _annotations(annotations, faults),
        }
        return root | found

    def _name_of(self, category: Row) -> Row:
        """The name that is given for a category's id, if one is."""
        number, names = category.get("id"), self.names or {}
        return {"name": names[number]} if type(number) is int and number in names else {}


def _objects(rows: object) -> list[Row] | None:
    """A list of objects; None for anything else, which the reader names."""
    return rows if isinstance(rows, list) and all(isinstance(row, dict) for row in rows) else None


def _without_doubles(categories: list[Row], used: Collection[int]) -> list[Row]:
    """Categories less those that nothing uses and that have another's name, such as Roboflow's first."""
    counts = Counter(str(c.get("name")).lower() for c in categories)
    return [
        c
        for c in categories
        if (type(c.get("id")) is int and c["id"] in used) or counts[str(c.get("name")).lower()] == 1
    ]


def _named(images: list[Row], frames: ImageFrames, faults: Faults) -> list[Row]:
    """Images with the names that their files had before a service changed them, counted as the recording is."""
    found, changed = [], []
    for image in images:
        name = image.get("file_name")
        extra = image.get("extra")
        own = extra.get("name") if isinstance(extra, dict) else None
        if isinstance(name, str):
            plain = own if isinstance(own, str) and own else _unhashed(name)
            changed += [(name, plain)] if plain != name else []
            image = image | {"file_name": plain}
        found.append(image)
    if changed:
        theirs, ours = changed[0]
        faults.note(
            f"{len(changed)} images have names that a service made, such as {quoted(theirs)}: read as {quoted(ours)}"
        )
    return found if frames.first is None else [_counted(image, frames) for image in found]


def _unhashed(name: str) -> str:
    last = re.split(r"[/\\]", name)[-1]
    for pattern, plain in _HASHED:
        match = pattern.fullmatch(last)
        if match:
            return match.expand(plain)
    return name


def _counted(image: Row, frames: ImageFrames) -> Row:
    """An image under the number of its frame, for numbers that begin with another than the recording's."""
    name = image.get("file_name")
    digits = re.search(r"(\d+)$", Path(name).stem, re.ASCII) if isinstance(name, str) else None
    number = image.get("id") if digits is None or len(digits[1]) > LARGEST_DIGITS else int(digits[1])
    if type(number) is not int:
        return image
    frame = frames.known(number, f"images id {quoted(image.get('id'))}")
    return image | {"file_name": f"{frame:06d}.png"}


def _annotations(rows: list[Row], faults: Faults) -> list[Row]:
    by_attributes = any(isinstance(row.get("attributes"), dict) for row in rows)
    found = [_annotation(row) for row in rows]
    steps: tuple[tuple[Callable[[Row], bool], str], ...] = (
        (lambda row: "_from_box" in row, "annotations without a mask: their box is taken for it"),
        (lambda row: "_points_lost" in row, "annotations with polygons of fewer than three points, which are left out"),
    )
    for is_so, what in steps:
        ids = [row.get("id") for row in found if is_so(row)]
        if ids:
            faults.note(f"{len(ids)} {what} (first: annotation {quoted(ids[0])})")
    if by_attributes and any(row.get("iscrowd") == 1 for row in found):
        count = sum(row.get("iscrowd") == 1 for row in found)
        faults.note(f"iscrowd 1 marks masks here, not crowds: {count} are read as objects")
        found = [row | {"iscrowd": 0} for row in found]
    tracks = {row["track_id"] for row in found if type(row.get("track_id")) is int}
    if tracks and any("track_id" not in row for row in rows):
        faults.note(f"tracks are taken from attributes or instance_id ({len(tracks)} differ)")
    return _numbered(found, faults)


def _numbered(rows: list[Row], faults: Faults) -> list[Row]:
    """With ids of their own, where some are missing or used twice (datumaro numbers each image anew)."""
    ids = [row.get("id") for row in rows]
    if all(type(id_) is int for id_ in ids) and len(set(ids)) == len(ids):
        return rows
    faults.note("ids of annotations are missing or used twice: they are numbered anew")
    return [row | {"id": i} for i, row in enumerate(rows, 1)]


def _annotation(row: Row) -> Row:
    """One annotation with its mask, track and score where the contract has them."""
    given = row.get("attributes")
    attributes: Row = given if isinstance(given, dict) else {}
    found = dict(row)
    if row.get("track_id") is None:
        track = next((t for t in _tracks(row, attributes) if t is not None), None)
        found = found if track is None else found | {"track_id": track}
    if row.get("score") is None:
        score = next((s for s in (row.get("confidence"), attributes.get("score")) if is_finite_number(s)), None)
        found.pop("score", None)
        found = found if score is None else found | {"score": score}
    return _with_mask(found)


def _tracks(row: Row, attributes: Row) -> Iterable[int | None]:
    """Track ids in the places where tools put them."""
    for value in (attributes.get("track_id"), row.get("instance_id")):
        if isinstance(value, str) and value.strip().isascii() and value.strip().isdigit() and len(value) < 16:
            yield int(value)
        yield value if type(value) is int else None


def _with_mask(row: Row) -> Row:
    """With a segmentation, if only that of the box; a box beside a mask goes: the mask's own is exact."""
    mask = row.get("segmentation")
    if isinstance(mask, list) and mask and all(is_finite_number(v) for v in mask):
        mask = [mask]
    if isinstance(mask, list) and all(isinstance(part, list) for part in mask):
        whole = [part for part in mask if len(part) >= 6]
        row = row | {"segmentation": whole} | ({"_points_lost": True} if len(whole) < len(mask) else {})
        mask = whole
    if mask:
        return {key: value for key, value in row.items() if key != "bbox"}
    box = row.get("bbox")
    if not isinstance(box, list) or len(box) != 4 or not all(is_finite_number(v) for v in box):
        return row
    x, y, w, h = box
    return row | {"segmentation": [[x, y, x + w, y, x + w, y + h, x, y + h]], "_from_box": True}
