"""Read and check a detection file: what is wrong is named with its file, its annotation and its key."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from meshslam.errors import DetectionError
from meshslam.geometry import Floats
from meshslam.perception.class_names import canonical_names, unknown_renaming, untracked
from meshslam.perception.coco import VEHICLES
from meshslam.perception.detections import CategoryEntry, Detection, DetectionSet, ImageEntry
from meshslam.perception.faults import Faults
from meshslam.perception.frame_matching import frames_of_images
from meshslam.perception.json_document import Entries, load_with_entries
from meshslam.perception.json_values import integer, is_name, kind, load_json, number, quoted, text
from meshslam.perception.keypoint_names import ours
from meshslam.perception.masks import Segmentation, is_finite_number, segmentation_box, segmentation_problem
from meshslam.perception.plausible import plausible
from meshslam.perception.undistorting import undistorted_detections
from meshslam.sequences import Report, Sequence

Entry = TypeVar("Entry", ImageEntry, CategoryEntry, Detection)
Part = TypeVar("Part")

LEAST_ANGLES = 4  # bins of a viewing angle's distribution
LARGEST_BOX_PX = 1e9
LARGEST_IMAGE_PX = 10**9
SCORE_OF_VISIBILITY = {0: 0.0, 1: 0.5, 2: 0.95}  # COCO's v where no scores are given: labelled but hidden; seen


def read_detections(path: Path) -> DetectionSet:
    """Read a detection file as docs/formats.md describes it.

    A missing `score` is 1, a missing `bbox` the mask's own. Missing `keypoint_scores` follow from v: 0.95 for 2, 0.5
    for 1, 0 for 0. A negative `track_id` is none. Key points outside the image carry no information, confidences above
    1 are 1: both are said in the set's `warnings`. Raises DetectionError for everything else that breaks the schema.
    """
    faults = Faults(Path(path))
    found, _ = _read(faults, None, None, ())
    return replace(found, warnings=tuple(faults.notes))


def read_recorded_detections(
    path: Path,
    sequence: Sequence | None,
    renamed: Mapping[str, str] | None = None,
    tracked: Collection[str] = VEHICLES,
    report: Report | None = None,
    prepare: Callable[[dict[str, Any], Faults], dict[str, Any]] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> DetectionSet:
    """Read the detections that come with a recording: as `read_detections`, then made plausible.

    Images are matched to the frames of `sequence` by `file_name`, which outranks ids; every frame gets an image. Names
    of categories are compared without regard to case, with those `tracked` too; `renamed` takes names to others. Crowd
    regions over other annotations are left out, boxes that contradict their masks are the masks' own, track ids count
    for a class, and an id that two annotations of a frame have is not used there. Detections of raw images are taken to
    the pinhole view of the recording's lens. All of this is said in the set's `warnings`.

    `prepare` brings what another tool wrote to the contract before it is read; `renamed` None keeps all names then.
    Without a `report` the first problem is raised as DetectionError; with one, all problems and notes are put there,
    and entries with problems are left out. `progress` is told how many annotations are read, of how many.
    """
    faults = Faults(Path(path), report, progress=progress)
    names = renamed if prepare is not None else renamed or {}
    found, crowd = _read(faults, sequence, names, tracked, prepare)
    found = plausible(found, crowd, faults)
    if sequence is not None and sequence.distortion is not None:
        found = undistorted_detections(found, sequence.distortion, faults)
    return replace(found, warnings=tuple(faults.notes))


def check_detections(
    path: Path, sequence: Sequence | None, report: Report, renamed: Mapping[str, str] | None = None
) -> None:
    """Put every problem and note of a recording's detection file into a report that collects.

    What runs refuse is a problem here, and nothing else is: both read with `read_recorded_detections`.
    """
    found = read_recorded_detections(path, sequence, renamed, report=report)
    unused = untracked(found, VEHICLES)
    if unused is not None:
        report.note(Path(path), "", unused)


def _read(
    faults: Faults,
    sequence: Sequence | None,
    renamed: Mapping[str, str] | None,
    tracked: Collection[str],
    prepare: Callable[[dict[str, Any], Faults], dict[str, Any]] | None = None,
) -> tuple[DetectionSet, frozenset[int]]:
    """The detections, and the ids of those with iscrowd 1."""
    load = partial(load_with_entries, key="annotations") if prepare is None else load_json
    root = faults.attempt("", lambda: _root(faults.path, load))
    if root is None:
        return DetectionSet((), (), ()), frozenset()
    root = root if prepare is None else prepare(root, faults)
    images = _entries(faults, root, "images", lambda row, _where: _image(row))
    rows = {key: _rows_by_id(root, key) for key in ("images", "categories")}
    named = {id_ for id_, row in (rows["images"] or {}).items() if "file_name" in row}
    frames = frames_of_images(images, named, sequence, faults)
    categories = _entries(faults, root, "categories", lambda row, _where: _category(row))
    unknown = unknown_renaming(renamed or {}, [c.name for c in categories])
    if unknown is not None:
        faults.add("categories", unknown)
    names = canonical_names(categories, renamed, tracked, faults)
    reader = _AnnotationReader(
        faults, rows, {i.id: i for i in images}, frames.of_image, {c.id: c for c in categories}, names.of_category
    )
    detections = _entries(faults, root, "annotations", reader.read)
    reader.tell()
    found = DetectionSet(frames.images, names.entries, detections, undistorted=_is_undistorted(root))
    return found, frozenset(reader.crowd)


def _root(path: Path, load: Callable[[Path], Any]) -> dict[str, Any]:
    root = load(path)
    if not isinstance(root, dict):
        raise DetectionError(f"{path}: found {kind(root)}, expected an object with images, categories and annotations")
    return root


def _is_undistorted(root: dict[str, Any]) -> bool:
    info = root.get("info")
    return isinstance(info, dict) and info.get("undistorted") is True


def _rows_by_id(root: dict[str, Any], key: str) -> dict[int, dict[str, Any]] | None:
    """Entries of a list that have an id, sound or not; None if there is no list."""
    rows = root.get(key)
    if not isinstance(rows, list):
        return None
    return {row["id"]: row for row in rows if isinstance(row, dict) and type(row.get("id")) is int}


def _entries(
    faults: Faults, root: dict[str, Any], key: str, read: Callable[[dict[str, Any], str], Entry | None]
) -> tuple[Entry, ...]:
    """Read the list under `key`, each entry with its place in the message; ids must differ."""
    rows = root.get(key)
    if not isinstance(rows, list | Entries):
        faults.add(key, f"{'found ' + kind(rows) if key in root else 'is missing'}, expected a list")
        return ()
    entries: dict[int, Entry] = {}
    for index, row in enumerate(rows):
        name = f" (id {quoted(row['id'])})" if isinstance(row, dict) and "id" in row else ""
        where = f"{key}[{index}]{name}"
        entry = faults.attempt(where, partial(_read_entry, read, row, where))
        if entry is None:
            continue
        if entry.id in entries:
            faults.add(where, f"id: {entry.id} is used twice, expected one entry per id")
        entries.setdefault(entry.id, entry)
        if faults.progress is not None and key == "annotations" and (index + 1) % 100 in (0, len(rows) % 100):
            faults.progress(index + 1, len(rows))
    return tuple(entries.values())


def _read_entry(read: Callable[[dict[str, Any], str], Entry | None], row: object, where: str) -> Entry | None:
    if not isinstance(row, dict):
        raise DetectionError(f"found {kind(row)}, expected an object")
    return read(row, where)


def _image(row: dict[str, Any]) -> ImageEntry:
    id_ = integer(row, "id")
    width, height = integer(row, "width"), integer(row, "height")
    if min(width, height) < 1 or width * height > LARGEST_IMAGE_PX:
        raise DetectionError(f"width, height: found {width} x {height}, expected an image's size in pixels")
    return ImageEntry(id_, text(row, "file_name", f"{id_:06d}.png"), width, height)


def _category(row: dict[str, Any]) -> CategoryEntry:
    given = row.get("keypoints") or []
    names = [ours(n) for n in given if is_name(n)] if isinstance(given, list) else []
    if not isinstance(given, list) or len(names) < len(given) or len(set(names)) < len(names):
        raise DetectionError("keypoints: expected a list of different names")
    return CategoryEntry(integer(row, "id"), text(row, "name"), tuple(names))


@dataclass
class _AnnotationReader:
    faults: Faults
    rows: Mapping[str, dict[int, dict[str, Any]] | None]  # of images and categories, sound or not
    images: dict[int, ImageEntry]
    frame_of_image: Mapping[int, int]
    categories: dict[int, CategoryEntry]
    name_of_category: Mapping[int, str]
    outside: list[int] = field(default_factory=list)  # annotation ids, one entry per key point
    above_one: list[int] = field(default_factory=list)
    crowd: list[int] = field(default_factory=list)
    sizes: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)  # of images, each held once
    boxed: dict[tuple[int, int], list[int]] = field(default_factory=dict)  # as run lengths have them

    def read(self, row: dict[str, Any], where: str) -> Detection | None:
        """One annotation; None if it has problems that were collected."""

        def part(read: Callable[[], Part]) -> Part | None:
            return self.faults.attempt(where, read)

        if self._is_told(row):
            return None
        id_ = part(lambda: integer(row, "id"))
        image = part(lambda: _known(row, "image_id", self.images, "images"))
        category = part(lambda: _known(row, "category_id", self.categories, "categories"))
        if id_ is None or image is None or category is None:
            return None
        before = self.faults.problem_count
        part(lambda: _check_mask(row, image))
        points = part(lambda: self._keypoints(row, id_, image, category))
        score = part(lambda: self._confidence(row.get("score", 1.0), "score", id_))
        box = part(lambda: _box(row))
        count = 0 if points is None or points[1] is None else len(points[1])
        sigmas = part(lambda: _positive(row, "keypoint_sigmas_px", count) if count else None)
        shares = part(lambda: _shares(row))
        track = part(lambda: _track(row))
        if points is None or score is None or self.faults.problem_count > before or image.id not in self.frame_of_image:
            return None
        size = self.sizes.setdefault((image.height, image.width), (image.height, image.width))
        self.crowd += [id_] if row.get("iscrowd") == 1 else []
        return Detection(
            id=id_,
            frame=self.frame_of_image[image.id],
            category=self.name_of_category[category.id],
            score=score,
            bbox=box or segmentation_box(row["segmentation"], *size),
            segmentation=self._shared(row["segmentation"]),
            image_size=size,
            keypoints=points[0],
            keypoint_scores=points[1],
            keypoint_sigmas_px=sigmas,
            viewing_angle_shares=shares,
            track_id=track,
        )

    def _shared(self, segmentation: Segmentation) -> Segmentation:
        """The same value; run lengths hold their size and their keys in common."""
        if isinstance(segmentation, list) or list(segmentation) != ["size", "counts"]:
            return segmentation
        height, width = segmentation["size"]
        return {"size": self.boxed.setdefault((height, width), [height, width]), "counts": segmentation["counts"]}

    def _is_told(self, row: dict[str, Any]) -> bool:
        """Whether the entry that an annotation belongs to has a problem, which was collected."""
        known = (("images", "image_id", self.images), ("categories", "category_id", self.categories))
        return any(
            type(row.get(key)) is int and row[key] not in sound and (rows is None or row[key] in rows)
            for (where, key, sound) in known
            for rows in (self.rows[where],)
        )

    def _keypoints(
        self, row: dict[str, Any], id_: int, image: ImageEntry, category: CategoryEntry
    ) -> tuple[Floats | None, Floats | None]:
        flat, count = row.get("keypoints"), len(category.keypoints)
        if flat is None or flat == []:
            return None, None
        if not isinstance(flat, list) or len(flat) != 3 * count:
            found = f"{len(flat)} numbers" if isinstance(flat, list) else kind(flat)
            name = quoted(category.name)
            expected = f"3 x {count} (x, y, v of each key point that `categories` names for {name})"
            raise DetectionError(f"keypoints: found {found}, expected {expected}")
        visibility = [_visibility(v) for v in flat[2::3]]
        xs, ys = ([_coordinate(x, v) for x, v in zip(flat[k::3], visibility, strict=True)] for k in (0, 1))
        points = np.array([xs, ys]).T.copy()  # of its own, in rows
        scores = self._keypoint_scores(row, id_, visibility)
        inside = ((points >= -0.5) & (points <= np.array([image.width, image.height]) - 0.5)).all(1)
        self.outside += [id_] * int((~inside & (scores > 0)).sum())
        return points, np.where(inside, scores, 0.0)

    def _keypoint_scores(self, row: dict[str, Any], id_: int, visibility: list[int]) -> Floats:
        given = row.get("keypoint_scores")
        if given is None:
            return np.array([SCORE_OF_VISIBILITY[v] for v in visibility])
        if not isinstance(given, list) or len(given) != len(visibility):
            found = f"{len(given)} numbers" if isinstance(given, list) else kind(given)
            raise DetectionError(f"keypoint_scores: found {found}, expected {len(visibility)}, one per key point")
        pairs = zip(given, visibility, strict=True)
        return np.array([self._confidence(s, "keypoint_scores", id_) if v else 0.0 for s, v in pairs])

    def _confidence(self, value: object, key: str, id_: int) -> float:
        score = number(value, key)
        if score < 0:
            raise DetectionError(f"{key}: found {score}, expected a confidence between 0 and 1")
        if score > 1:
            self.above_one.append(id_)
        return min(score, 1.0)

    def tell(self) -> None:
        """Sum up what was handled, one line a kind."""
        said = {
            "key points outside their image, taken as no information": self.outside,
            "confidences above 1, taken as 1": self.above_one,
        }
        for what, ids in said.items():
            if ids:
                self.faults.note(f"{what}: {len(ids)} (first: annotation {ids[0]})")


def _known(row: dict[str, Any], key: str, known: dict[int, Part], where: str) -> Part:
    id_ = integer(row, key)
    if id_ not in known:
        raise DetectionError(f"{key}: found {id_}, expected the id of an entry of `{where}`")
    return known[id_]


def _check_mask(row: dict[str, Any], image: ImageEntry) -> None:
    if "segmentation" not in row:
        raise DetectionError("segmentation: is missing, expected run lengths or polygons")
    problem = segmentation_problem(row["segmentation"], image.height, image.width)
    if problem:
        raise DetectionError(f"segmentation: {problem}")


def _track(row: dict[str, Any]) -> int | None:
    """The track; trackers write a negative number for none."""
    if row.get("track_id") is None:
        return None
    id_ = integer(row, "track_id", least=-(2**53))
    return id_ if id_ >= 0 else None


def _positive(row: dict[str, Any], key: str, count: int) -> Floats | None:
    given = row.get(key)
    if given is None:
        return None
    if not isinstance(given, list) or len(given) != count:
        raise DetectionError(f"{key}: expected {count} numbers, one per key point")
    values = np.array([number(value, key) for value in given])
    if (values <= 0).any():
        raise DetectionError(f"{key}: found {values.min()}, expected pixels above 0")
    return values


def _shares(row: dict[str, Any]) -> Floats | None:
    key = "viewing_angle_shares"
    given = row.get(key)
    if given is None:
        return None
    if not isinstance(given, list) or len(given) < LEAST_ANGLES:
        raise DetectionError(f"{key}: expected a list of at least {LEAST_ANGLES} shares")
    values = np.array([number(value, key) for value in given])
    with np.errstate(over="ignore"):
        total = float(values.sum())
    if (values < 0).any() or not 0 < total < float("inf"):
        raise DetectionError(f"{key}: expected shares that are not negative, and not all 0")
    return values


def _box(row: dict[str, Any]) -> tuple[float, float, float, float] | None:
    """The box in pixels; None where none is given."""
    value = row.get("bbox")
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 4:
        raise DetectionError(f"bbox: found {quoted(value)}, expected [x, y, width, height]")
    x, y, width, height = (number(v, "bbox", LARGEST_BOX_PX) for v in value)
    if min(width, height) < 0:
        found = quoted(value)
        raise DetectionError(f"bbox: found {found}, expected [x, y, width, height] with a size that is not negative")
    return x, y, width, height


def _visibility(value: object) -> int:
    if not is_finite_number(value) or value not in SCORE_OF_VISIBILITY:
        raise DetectionError(f"keypoints: found v = {quoted(value)}, expected 0, 1 or 2")
    return int(value)


def _coordinate(value: object, visibility: int) -> float:
    """Read a coordinate in pixels; where v = 0 it may be anything, and what is no number becomes 0."""
    if visibility == 0 and not is_finite_number(value):
        return 0.0
    return number(value, "keypoints")
