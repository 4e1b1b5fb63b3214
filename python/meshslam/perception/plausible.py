"""What a detection file says that cannot be meant: found in the detections themselves, put right, and said."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Sequence
from dataclasses import replace

from meshslam.perception.coco import VEHICLES, association_group
from meshslam.perception.detections import Detection, DetectionSet
from meshslam.perception.faults import Faults
from meshslam.perception.json_values import quoted
from meshslam.perception.masks import covered_shares, segmentation_box

COVERED = 0.5  # share of a mask inside a crowd region that makes it one of the crowd
BOX_OVERLAP = 0.5  # IoU of a box with its mask's: less is a box of another kind
MOST = 0.5  # share of a file's boxes that are of another kind: then all are

Box = tuple[float, float, float, float]


def plausible(found: DetectionSet, crowd: Collection[int], faults: Faults) -> DetectionSet:
    """The detections without crowd regions, each with the box of its mask and a track that is one object's.

    `crowd` are the ids of annotations with iscrowd 1. What is changed is told to `faults`.
    """
    detections = _without_crowds(found.detections, crowd, faults)
    detections = _with_own_boxes(detections, faults)
    detections = _with_tracks_of_a_class(detections, faults)
    return replace(found, detections=_without_doubled_tracks(detections, faults))


def _without_crowds(detections: Sequence[Detection], crowd: Collection[int], faults: Faults) -> tuple[Detection, ...]:
    """Leave out crowd regions that cover other annotations; a file in which all are crowds holds objects."""
    if not crowd:
        return tuple(detections)
    if all(d.id in crowd for d in detections):
        faults.note(f"all {len(detections)} annotations have iscrowd 1: they are read as objects")
        return tuple(detections)
    frames = _by_frame(detections)
    gone = {d.id for d in detections if d.id in crowd and _covers(d, frames[d.frame], crowd)}
    if gone:
        faults.note(f"regions with iscrowd 1 that cover other annotations are left out: {_some(gone)}")
    if set(crowd) - gone:
        faults.note(f"iscrowd 1, but no other annotation is covered: read as objects: {_some(set(crowd) - gone)}")
    return tuple(d for d in detections if d.id not in gone)


def _covers(region: Detection, others: Iterable[Detection], crowd: Collection[int]) -> bool:
    single = [d.segmentation for d in others if d.id not in crowd]
    return bool((covered_shares(single, region.segmentation, *region.image_size) >= COVERED).any())


def _with_own_boxes(detections: Sequence[Detection], faults: Faults) -> tuple[Detection, ...]:
    """Boxes that are not their mask's are replaced by it; where most are not, all are."""
    boxes = [segmentation_box(d.segmentation, *d.image_size) for d in detections]
    wrong = [i for i, (d, box) in enumerate(zip(detections, boxes, strict=True)) if _contradicts(d.bbox, box)]
    if not wrong:
        return tuple(detections)
    first = detections[wrong[0]]
    every = len(wrong) > MOST * len(detections)
    used = "all boxes are taken from the masks" if every else "these are taken from the masks"
    faults.note(
        f"bbox is not x, y, width, height of the mask (IoU under {BOX_OVERLAP}) in {len(wrong)} of {len(detections)} "
        f"annotations (first: annotation {first.id}): {used}"
    )
    chosen = set(range(len(detections))) if every else set(wrong)
    return tuple(replace(d, bbox=boxes[i]) if i in chosen else d for i, d in enumerate(detections))


def _contradicts(given: Box, own: Box) -> bool:
    """Whether a box is not that of the mask, which has pixels; boxes x, y, width, height."""
    if own[2] <= 0 or own[3] <= 0:
        return False
    width = min(given[0] + given[2], own[0] + own[2]) - max(given[0], own[0])
    height = min(given[1] + given[3], own[1] + own[3]) - max(given[1], own[1])
    shared = max(0.0, width) * max(0.0, height)
    return shared < BOX_OVERLAP * (given[2] * given[3] + own[2] * own[3] - shared)


def _with_tracks_of_a_class(detections: Sequence[Detection], faults: Faults) -> tuple[Detection, ...]:
    """One id in several classes is several tracks: vehicles keep the id, the others get new ones."""
    per_class = _count_for_each_class(detections)
    keys = [_track_key(d, per_class=per_class) for d in detections]
    owner: dict[int, Hashable] = {}
    for d, key in sorted(zip(detections, keys, strict=True), key=lambda pair: pair[0].category not in VEHICLES):
        if d.track_id is not None:
            owner.setdefault(d.track_id, key)
    moved: dict[Hashable, int] = {}
    largest = max(owner, default=0)
    for d, key in zip(detections, keys, strict=True):
        if d.track_id is not None and owner[d.track_id] != key:
            moved.setdefault(key, largest + 1 + len(moved))
    if moved:
        first = next(d for d, key in zip(detections, keys, strict=True) if key in moved)
        faults.note(
            f"track ids are counted for each class: {len(moved)} that other classes have too get new numbers from "
            f"{largest + 1} on (first: {quoted(first.category)} {first.track_id} of annotation {first.id})"
        )
    return tuple(d.with_track(moved[key]) if key in moved else d for d, key in zip(detections, keys, strict=True))


def _track_key(detection: Detection, *, per_class: bool) -> Hashable:
    group = detection.category if per_class else association_group(detection.category)
    return None if detection.track_id is None else (group, detection.track_id)


def _count_for_each_class(detections: Sequence[Detection]) -> bool:
    """Whether one id is in one frame that of vehicles of two classes; if never, networks flip between classes."""
    seen: dict[tuple[int, int], str] = {}
    of_vehicles = [d for d in detections if d.track_id is not None and d.category in VEHICLES]
    return any(seen.setdefault((d.frame, d.track_id or 0), d.category) != d.category for d in of_vehicles)


def _without_doubled_tracks(detections: Sequence[Detection], faults: Faults) -> tuple[Detection, ...]:
    """An id that two annotations of one frame have says nothing there."""
    counts = Counter((d.frame, d.track_id) for d in detections if d.track_id is not None)
    doubled = {key for key, count in counts.items() if count > 1}
    if not doubled:
        return tuple(detections)
    frame, track = min(doubled, key=lambda key: (key[0], key[1] or 0))
    faults.note(
        f"two annotations of one frame have one track_id, which is not used there: in {len(doubled)} cases "
        f"(first: track {track} in frame {frame})"
    )
    return tuple(d.with_track(None) if (d.frame, d.track_id) in doubled else d for d in detections)


def _by_frame(detections: Iterable[Detection]) -> dict[int, list[Detection]]:
    frames: dict[int, list[Detection]] = {}
    for detection in detections:
        frames.setdefault(detection.frame, []).append(detection)
    return frames


def _some(ids: Collection[int]) -> str:
    return f"{len(ids)} (first: annotation {min(ids)})"
