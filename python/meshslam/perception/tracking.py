"""Follow objects through a sequence: every detection gets the number of its object (paper, Sec. IV-A)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from meshslam.geometry import Bytes, Floats
from meshslam.perception.association import (
    Expected,
    Followed,
    affinity,
    assign,
    assign_greedily,
    paper_score,
    size_ratio,
)
from meshslam.perception.coco import VEHICLES
from meshslam.perception.detections import Detection, DetectionSet
from meshslam.perception.flow import Flow, follow, grey, scale_and_shift
from meshslam.perception.tracked_mask import TrackedMask, shared_area_px, tracked_mask
from meshslam.settings import Settings, expert, public

FORCED = 10.0  # score of a detection that was given to the object
ENOUGH_POINTS = 4  # to tell where an object has gone
LEAST_AHEAD = 0.2  # depth of what was at depth 1 before a turn: less is beside the camera

Turn = Callable[[int, int], Floats]  # two frames to the homography (3, 3) of far points from one to the other


@dataclass(frozen=True)
class TrackerConfig(Settings):
    """How detections are joined."""

    tracker: Literal["hungarian", "paper"] = public("hungarian", doc="paper: greedy, tracks that are lost end")
    categories: tuple[str, ...] = public(tuple(sorted(VEHICLES)), doc="categories of the detections that are tracked")
    min_score: float = expert(0.3, low=0, high=1)  # affinity of a match
    min_overlap: float = expert(0.1, low=0, high=1)  # likewise where there are no images, so that masks alone decide
    size_factor: float = expert(1.5, low=1)  # of boxes in consecutive frames; beyond: lost (paper) or less likely
    max_gap: int = expert(5, low=0)  # frames in a row in which an object may be missed
    corners: int = expert(60, low=1)  # that are followed per object
    nested_share: float = expert(0.75, low=0, high=1)  # a mask with this share in a better one of its group is the same


def track(
    detections: DetectionSet,
    read_image: Callable[[int], Bytes] | None,
    config: TrackerConfig | None = None,
    progress: Callable[[int], None] | None = None,
    turn: Turn | None = None,
) -> DetectionSet:
    """Give numbers to the objects that detections of `config.categories` show: 1, 2, ... by first appearance.

    A `track_id` that was given stays; where all are given, no image is read. `read_image` takes a frame number to a BGR
    image; without images, masks and boxes that move evenly decide. `turn` says how the camera turns between two frames.
    Detections inside a better one stay without a track.
    """
    config = config or TrackerConfig()
    wanted = [d for d in detections.detections if d.category in config.categories]
    if all(d.track_id is not None for d in wanted):
        return detections
    tracker, last = Tracker(config), None
    for frame, found in detections.by_frame().items():
        image = grey(read_image(frame)) if read_image else None
        turned = turn(last, frame) if turn is not None and last is not None else None
        tracker.step([d for d in found if d.category in config.categories], image, turned)
        last = frame
        if progress:
            progress(frame)
    given = {d.track_id for d in detections.detections if d.track_id is not None}
    return detections.with_tracks(tracker.numbers(given))


def voted_category(detections: Sequence[Detection]) -> str:
    """Return the category of one object's detections: each votes with its score and its size (networks flip)."""
    votes: dict[str, float] = {}
    for d in detections:
        votes[d.category] = votes.get(d.category, 0.0) + d.score * float(np.sqrt(d.area_px))
    return max(sorted(votes), key=lambda name: votes[name])


@dataclass
class TrackedObject:
    """An object that is followed."""

    tracked: TrackedMask  # in the last frame: seen or predicted
    last_seen: Floats  # box, brought along as the camera turns
    given: int | None
    members: list[int]  # ids of detections; online, of the newest frame's alone
    motion: Floats = field(default_factory=lambda: np.zeros(4))  # of the box, px a frame, without the camera's turning
    missed: int = 0
    views: int = 1  # detections so far


@dataclass
class Tracker:
    """Feed it frames in their order."""

    config: TrackerConfig
    active: list[TrackedObject] = field(default_factory=list)
    last_image: Bytes | None = None
    order: list[TrackedObject] = field(default_factory=list)  # by first appearance

    def step(self, detections: Sequence[Detection], image: Bytes | None, turned: Floats | None = None) -> None:
        """Take in one frame; `turned`: the homography of far points from the last frame to it."""
        seen = [(d, s) for d in detections if (s := tracked_mask(d, image, self.config.corners)) is not None]
        seen = _without_nested(seen, self.config.nested_share)
        ahead = _follow([o.tracked for o in self.active], self.last_image, image)
        behind = _follow([s for _, s in seen], image, self.last_image)
        for object_ in self.active:
            object_.last_seen = _turned(object_.last_seen, turned)
        expected = [Expected(f, _predict(o, f, turned)) for o, f in zip(self.active, ahead, strict=True)]
        pairs = self._match(expected, [d for d, _ in seen], behind)
        missed = set(range(len(self.active))) - {row for row, _ in pairs}
        for row, column in pairs:
            self._continue(self.active[row], *seen[column])
        for row in missed:
            _miss(self.active[row], expected[row])
        self.active = [o for o in self.active if o.missed <= self._patience() and _in_view(o.tracked)]
        for column in sorted(set(range(len(seen))) - {column for _, column in pairs}):
            self._start(*seen[column])
        self.last_image = image

    def numbers(self, given: set[int]) -> dict[int, int]:
        """Take detections to the numbers of their objects; new numbers avoid the given ones."""
        numbers: dict[int, int] = {}
        free = (n for n in range(1, len(self.order) + len(given) + 2) if n not in given)
        for object_ in self.order:
            number = object_.given if object_.given is not None else next(free)
            numbers.update(dict.fromkeys(object_.members, number))
        return numbers

    def _patience(self) -> int:
        return 0 if self.config.tracker == "paper" else self.config.max_gap

    def _match(
        self, expected: Sequence[Expected], detections: Sequence[Detection], behind: Sequence[Followed]
    ) -> list[tuple[int, int]]:
        """Pairs (active object, detection)."""
        scores = np.zeros((len(expected), len(detections)))
        taken = {o.given for o in self.order}
        for row, (object_, outlook) in enumerate(zip(self.active, expected, strict=True)):
            for column, (detection, followed) in enumerate(zip(detections, behind, strict=True)):
                if detection.track_id is not None and detection.track_id == object_.given:
                    scores[row, column] = FORCED
                elif detection.track_id is None or (object_.given is None and detection.track_id not in taken):
                    scores[row, column] = self._score(outlook, followed)
        if self.config.tracker == "paper":
            return [(r, c) for r, c in assign_greedily(scores) if self._of_a_size(expected[r], behind[c], scores[r, c])]
        return assign(scores, self.config.min_score if self.last_image is not None else self.config.min_overlap)

    def _of_a_size(self, outlook: Expected, detection: Followed, score: float) -> bool:
        return score == FORCED or size_ratio(outlook.followed.tracked, detection.tracked) <= self.config.size_factor

    def _score(self, outlook: Expected, detection: Followed) -> float:
        if outlook.predicted.group != detection.tracked.group:
            return 0.0
        if self.config.tracker == "paper":
            return paper_score(outlook.followed, detection)
        excess = size_ratio(outlook.predicted, detection.tracked) / self.config.size_factor
        return affinity(outlook, detection) / max(1.0, excess)

    def _continue(self, object_: TrackedObject, detection: Detection, seen: TrackedMask) -> None:
        steps = object_.missed + 1
        motion = (seen.box - object_.last_seen) / steps
        object_.motion = motion if object_.views == 1 else 0.5 * (motion + object_.motion)
        object_.tracked, object_.last_seen, object_.missed = seen, seen.box, 0
        object_.given = object_.given if object_.given is not None else detection.track_id
        object_.members.append(detection.id)
        object_.views += 1

    def _start(self, detection: Detection, seen: TrackedMask) -> None:
        self.active.append(TrackedObject(seen, seen.box, detection.track_id, [detection.id]))
        self.order.append(self.active[-1])


def _miss(object_: TrackedObject, expected: Expected) -> None:
    """Go on with the prediction: its mask, and the corners that could be followed."""
    flow = expected.followed.points
    object_.tracked = replace(expected.predicted, points=flow.points[flow.good])
    object_.missed += 1


def _follow(tracked: Sequence[TrackedMask], here: Bytes | None, there: Bytes | None) -> list[Followed]:
    """Follow the corners and key points of every mask from one image to the other, all in one go."""
    parts = [part for s in tracked for part in (s.points, s.keypoints)]
    if here is None or there is None or not parts:
        return [Followed(s, _lost(s.points), _lost(s.keypoints)) for s in tracked]
    flow = follow(here, there, np.concatenate(parts))
    ends = np.cumsum([len(part) for part in parts])
    flows = [flow.part(end - len(part), end) for part, end in zip(parts, ends.tolist(), strict=True)]
    return [Followed(s, flows[2 * i], flows[2 * i + 1]) for i, s in enumerate(tracked)]


def _lost(points: Floats) -> Flow:
    return Flow(points, points, np.zeros(len(points), bool))


def _turned(box: Floats, homography: Floats | None) -> Floats:
    """Where a box is after the camera has turned; it stays where it is if it would be beside or behind the camera."""
    if homography is None:
        return box
    corners = np.array([[box[0], box[1], 1], [box[2], box[1], 1], [box[2], box[3], 1], [box[0], box[3], 1]])
    moved = corners @ homography.T
    if (moved[:, 2] < LEAST_AHEAD).any():
        return box
    pixels = moved[:, :2] / moved[:, 2:]
    size, middle = box[2:] - box[:2], (pixels.min(0) + pixels.max(0)) / 2
    return np.concatenate([middle - size / 2, middle + size / 2])


def _predict(object_: TrackedObject, followed: Followed, turned: Floats | None) -> TrackedMask:
    """Expect the mask where its corners have gone; with too few of them, where turning and even motion lead the box."""
    seen, flow = object_.tracked, followed.points
    if flow.good.sum() < ENOUGH_POINTS:
        x0, y0, x1, y1 = _turned(seen.box, turned) + object_.motion
        return seen.moved(np.array([x0, y0, max(x1, x0 + 1), max(y1, y0 + 1)]))
    scale, centre, new_centre = scale_and_shift(seen.points[flow.good], flow.points[flow.good])
    return seen.moved(((seen.box.reshape(2, 2) - centre) * scale + new_centre).reshape(4))


def _in_view(seen: TrackedMask) -> bool:
    height, width = seen.image_size
    x, y = seen.box.reshape(2, 2).mean(0)
    return bool(0 <= x < width and 0 <= y < height)


def _without_nested(seen: list[tuple[Detection, TrackedMask]], share: float) -> list[tuple[Detection, TrackedMask]]:
    """Drop masks that lie in a better one of their group; the better is the larger unless it scores much lower."""
    kept: list[tuple[Detection, TrackedMask]] = []
    for detection, s in sorted(seen, key=lambda pair: (-pair[0].score * np.sqrt(pair[1].mask.sum()), pair[0].id)):
        area = int(s.mask.sum())
        rivals = [k for _, k in kept if k.group == s.group]
        if all(shared_area_px(s, k) < share * min(area, int(k.mask.sum())) for k in rivals):
            kept.append((detection, s))
    return sorted(kept, key=lambda pair: pair[0].id)
