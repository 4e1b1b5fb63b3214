"""Tracking of a stream: every frame's detections get the numbers of their objects as they come."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from meshslam.geometry import Bytes, Floats
from meshslam.perception.detections import Detection
from meshslam.perception.flow import grey
from meshslam.perception.tracked_mask import TrackedMask
from meshslam.perception.tracking import TrackedObject, Tracker, TrackerConfig

_ARRAYS = ("mask", "points", "keypoints", "weights")  # of a tracked mask


class OnlineTracker:
    """As `track`, frame by frame: new objects get the numbers 1, 2, ... in the order in which they appear.

    A `track_id` that a detection brings stays; a number of ours that is taken is passed over.
    """

    def __init__(self, config: TrackerConfig | None = None) -> None:
        self._tracker = Tracker(config or TrackerConfig())
        self._number_of: dict[int, int] = {}  # by the object's place in the order of first appearance
        self._taken: set[int] = set()

    def process(
        self, detections: Sequence[Detection], image_bgr: Bytes | None = None, turn: Floats | None = None
    ) -> tuple[Detection, ...]:
        """The next frame's detections with their tracks; `turn` (3, 3) is the homography of far points to it."""
        tracker = self._tracker
        wanted = [d for d in detections if d.category in tracker.config.categories]
        self._taken |= {d.track_id for d in wanted if d.track_id is not None}
        tracker.step(wanted, None if image_bgr is None else grey(image_bgr), turn)
        numbers: dict[int, int] = {}
        for place, object_ in enumerate(tracker.order):
            number = object_.given if object_.given is not None else self._number(place)
            numbers.update(dict.fromkeys(object_.members, number))
            object_.members = []  # what was numbered need not be kept, and ids may be given anew in each frame
        return tuple(d.with_track(numbers[d.id]) if d.id in numbers else d for d in detections)

    def _number(self, place: int) -> int:
        if place not in self._number_of:
            number = max(self._number_of.values(), default=0) + 1
            while number in self._taken:
                number += 1
            self._number_of[place] = number
        return self._number_of[place]

    def to_arrays(self) -> dict[str, Any]:
        """All that is held, as plain arrays."""
        tracker = self._tracker
        active = [next(i for i, o in enumerate(tracker.order) if o is a) for a in tracker.active]
        plain = {
            "objects": [[o.given, o.missed, o.views] for o in tracker.order],
            "active": active,
            "masks": [[o.tracked.group, o.tracked.left, o.tracked.top, o.tracked.image_size] for o in tracker.active],
            "numbers": sorted(self._number_of.items()),
            "taken": sorted(self._taken),
        }
        arrays: dict[str, Any] = {"tracker": np.array(json.dumps(plain))}
        if tracker.last_image is not None:
            arrays["last_image"] = tracker.last_image
        for i, object_ in enumerate(tracker.active):
            arrays |= {f"{name}_{i}": getattr(object_.tracked, name) for name in _ARRAYS}
            arrays[f"boxes_{i}"] = np.stack([object_.last_seen, object_.motion])
        return arrays

    def fill(self, arrays: Mapping[str, Any]) -> None:
        """The reverse of `to_arrays`."""
        plain, tracker = json.loads(str(arrays["tracker"])), self._tracker
        gone = TrackedMask("", 0, 0, np.zeros((1, 1), np.uint8), (1, 1), *(np.zeros((0, 2)),) * 2, np.zeros(0))
        tracker.order = [
            TrackedObject(gone, np.zeros(4), given, [], missed=missed, views=views)
            for given, missed, views in plain["objects"]
        ]
        tracker.active = [tracker.order[i] for i in plain["active"]]
        for i, (object_, (group, left, top, size)) in enumerate(zip(tracker.active, plain["masks"], strict=True)):
            held = {name: np.asarray(arrays[f"{name}_{i}"]) for name in _ARRAYS}
            object_.tracked = TrackedMask(group=group, left=left, top=top, image_size=tuple(size), **held)
            object_.last_seen, object_.motion = (np.asarray(row, float) for row in arrays[f"boxes_{i}"])
        tracker.last_image = np.asarray(arrays["last_image"], np.uint8) if "last_image" in arrays else None
        self._number_of = {place: number for place, number in plain["numbers"]}
        self._taken = set(plain["taken"])
