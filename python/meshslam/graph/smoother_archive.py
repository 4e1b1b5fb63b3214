"""A smoother with its history as plain arrays, and back: what is read back goes on as what was saved, bit by bit.

Factors are saved as what they were made of, and beside it as the rows in whose place they are held linear. What
variables left behind has its rows only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gtsam.symbol_shorthand import O, Z

from meshslam.errors import MapError
from meshslam.features import PointConfig, PointTracks
from meshslam.geometry import Camera, Floats, Ints, NoiseModel, ObjectModel, Pose, SquareRoot
from meshslam.graph.camera_states import CameraStates
from meshslam.graph.full_trajectory import History
from meshslam.graph.graph_archive import (
    Arrays,
    linear_from_arrays,
    linear_to_arrays,
    records_from_arrays,
    records_to_arrays,
    values_from_arrays,
    values_to_arrays,
)
from meshslam.graph.object_factor import CameraMemo, ObservationCost
from meshslam.graph.point_factor import PointTerm, point_factor, point_term
from meshslam.graph.record_factors import factor_of
from meshslam.graph.records import Record
from meshslam.graph.smoother import Smoother
from meshslam.graph.tags import DISPLACEMENT, ObservationTag, PointTag, RoadTag
from meshslam.graph.view_terms import ViewTerm, view_factor
from meshslam.graph.window import Entry, Linearized
from meshslam.objects import views_from_arrays, views_to_arrays

_LEFT_BEHIND, _RECORD, _POINTS, _OBSERVATION = range(4)  # what a factor was made of


def smoother_to_arrays(smoother: Smoother) -> Arrays:
    """All that a smoother with a history holds."""
    assert smoother.history is not None
    entries = [*smoother.history.entries, *smoother.window.entries]
    count = len(smoother.history.entries)
    rows = [(_source(e), e.linearized is not None, *_tag_to_plain(e.tag)) for e in entries]
    arrays = {f"window_{k}": v for k, v in values_to_arrays(smoother.window.values).items()}
    arrays |= {f"past_{k}": v for k, v in values_to_arrays(smoother.history.values).items()}
    arrays |= {"entries": np.array(rows, np.int64).reshape(-1, 5), "past_count": np.array(count)}
    made = {
        "record": records_to_arrays([e.record for e in entries if e.record is not None]),
        "linear": linear_to_arrays([e.linearized for e in entries if e.linearized is not None]),
        "points": _points_to_arrays([e.origin_term for e in entries if isinstance(e.origin_term, PointTerm)]),
        "view": _views_to_arrays([e.tag for e in entries if isinstance(e.tag, ObservationTag)], smoother),
        "frames": smoother.cameras.to_arrays() | smoother.objects.to_arrays(),
    }
    return arrays | {f"{name}_{k}": v for name, some in made.items() for k, v in some.items()}


def smoother_from_arrays(
    empty: Smoother, arrays: Mapping[str, Any], model: ObjectModel, noise: NoiseModel, camera: Camera
) -> None:
    """Fill a smoother that has not begun; MapError, or whatever NumPy raises, for arrays that do not fit each other."""
    history = empty.history = History(values_from_arrays(_under("past_", arrays)))
    empty.window.values = values_from_arrays(_under("window_", arrays))
    tables = _under("frames_", arrays)
    empty.cameras.fill(tables)
    views = _under("view_", arrays)
    reader = _Reader(
        _AllCameras(empty.cameras),
        records_from_arrays(_under("record_", arrays)),
        linear_from_arrays(_under("linear_", arrays)),
        _points_from_arrays(_under("points_", arrays)),
        _views_from_arrays(views, model, noise, camera),
        camera,
    )
    entries = [reader.entry(*row) for row in arrays["entries"].tolist()]
    reader.check_ended()
    count = int(arrays["past_count"])
    history.entries, empty.window.entries = entries[:count], entries[count:]
    tags = [e.tag for e in entries if isinstance(e.tag, ObservationTag)]
    ranked = sorted((rank, k) for k, rank in enumerate(views["rank"].tolist()) if rank >= 0)
    empty.objects.fill(tables, [tags[k] for _, k in ranked])


def _source(entry: Entry) -> int:
    if entry.origin is None:
        return _LEFT_BEHIND
    if isinstance(entry.tag, ObservationTag):
        return _OBSERVATION
    if isinstance(entry.origin_term, PointTerm):
        return _POINTS
    assert entry.record is not None  # of all other factors that a smoother with a history takes in
    return _RECORD


@dataclass
class _AllCameras:
    """The cameras of all frames, those that left the window too."""

    held: CameraStates
    _memos: dict[int, CameraMemo] = field(default_factory=dict)

    @property
    def arm_m(self) -> Floats:
        return self.held.arm_m

    def memo(self, frame: int) -> CameraMemo:
        if self.held.holds(frame):
            return self.held.memo(frame)
        if frame not in self._memos:
            self._memos[frame] = CameraMemo(self.arm_m, self.held.rates_rad_s[frame])
        return self._memos[frame]


@dataclass
class _Reader:
    """Makes factors in their order of what they were made of."""

    cameras: _AllCameras
    records: Iterator[Record]
    linear: Iterator[Linearized]
    points: Iterator[tuple[PointConfig, tuple[Floats, ...]]]
    views: Iterator[ObservationTag]
    camera: Camera

    def entry(self, source: int, is_linear: bool, kind: int, one: int, other: int) -> Entry:
        """The next one."""
        tag = _tag(kind, one, other)
        if source == _LEFT_BEHIND:
            held = next(self.linear)
            return Entry(held.factor(), frozenset(held.keys), term=held.term(), linearized=held)
        made = self._made(source, tag)
        if is_linear:
            held = next(self.linear)
            made.factor, made.term, made.linearized = held.factor(), held.term(), held
        return made

    def check_ended(self) -> None:
        """MapError if something is left over."""
        for name, rest in vars(self).items():
            if isinstance(rest, Iterator) and next(rest, None) is not None:
                raise MapError(f"a saved graph has {name} that belong to nothing")

    def _made(self, source: int, tag: object) -> Entry:
        if source == _RECORD:
            record = next(self.records)
            factor = factor_of(record, self.cameras)
            return Entry(factor, frozenset(record.keys), tag, factor, record=record)
        if source == _POINTS and isinstance(tag, PointTag):
            points = self._point_term(tag, *next(self.points))
            return _with_term(point_factor(points), points, tag)
        view = next(self.views)
        keys, memo = self.cameras.held.keys(view.frame), self.cameras.memo(view.frame)
        term = ViewTerm(view.cost, keys, memo, O(view.number), Z(view.number))
        return _with_term(view_factor(term), term, view)

    def _point_term(self, tag: PointTag, config: PointConfig, tracks: tuple[Floats, ...]) -> PointTerm:
        block = PointTracks(tag.row, tag.first, tracks, is_closed=False, matches=np.zeros((0, 2, 2)))
        frames = range(block.first, block.last + 1)
        keys = {f: self.cameras.held.keys(f) for f in frames}
        return point_term(block, keys, {f: self.cameras.memo(f) for f in frames}, self.camera, config)


def _with_term(factor: Any, term: PointTerm | ViewTerm, tag: object) -> Entry:  # noqa: ANN401 # one of GTSAM's
    return Entry(factor, frozenset(term.keys), tag, factor, term, term)


def _tag_to_plain(tag: object) -> tuple[int, int, int]:
    """What a factor belongs to: its kind and two numbers."""
    if isinstance(tag, RoadTag):
        return 1, tag.number, 0
    if isinstance(tag, PointTag):
        return 2, tag.row, tag.first
    return (3, 0, 0) if tag == DISPLACEMENT else (0, 0, 0)


def _tag(kind: int, one: int, other: int) -> object:
    return [None, RoadTag(one), PointTag(one, other), DISPLACEMENT][kind]


def _under(prefix: str, arrays: Mapping[str, Any]) -> Arrays:
    return {key.removeprefix(prefix): value for key, value in arrays.items() if key.startswith(prefix)}


def _points_to_arrays(terms: list[PointTerm]) -> Arrays:
    tracks = [term.points.tracks for term in terms]
    shapes = [some.shape[:2] for block in tracks for some in block]
    pixels = np.concatenate([np.zeros(0), *(some.ravel() for block in tracks for some in block)])
    single = pixels.astype(np.float32)  # which is what optical flow finds
    return {
        "noise": np.array([[term.points.sigma_px, term.points.kernel] for term in terms]).reshape(-1, 2),
        "counts": np.array([len(block) for block in tracks], np.int64),
        "shapes": np.array(shapes, np.int64).reshape(-1, 2),
        "pixels": single if np.array_equal(single, pixels) else pixels,
    }


def _points_from_arrays(arrays: Arrays) -> Iterator[tuple[PointConfig, tuple[Floats, ...]]]:
    ends = np.cumsum(2 * arrays["shapes"].prod(axis=1))
    pixels = np.split(arrays["pixels"].astype(float), ends[:-1])
    groups = iter(zip(pixels, arrays["shapes"].tolist(), strict=False))
    for (sigma_px, kernel), count in zip(arrays["noise"].tolist(), arrays["counts"].tolist(), strict=True):
        some = [next(groups) for _ in range(count)]
        tracks = tuple(values.reshape(*shape, 2) for values, shape in some)
        yield PointConfig(sigma_px=sigma_px, kernel=kernel), tracks


def _views_to_arrays(tags: list[ObservationTag], smoother: Smoother) -> Arrays:
    rank = {id(tag): k for k, tag in enumerate(smoother.objects.open_observations())}
    frozen = [tag.cost.frozen for tag in tags]
    size = len(frozen[0][2].root) if frozen else 0
    triangle = np.triu_indices(size)
    views = [tag.cost.view for tag in tags]
    made = views_to_arrays([view for view in views if view is not None])
    return {f"made_of_{name}": value for name, value in made.items()} | {
        "is_frozen": np.array([view is None for view in views], bool),
        "rank": np.array([rank.get(id(tag), -1) for tag in tags], np.int64),
        "number": np.array([tag.number for tag in tags], np.int64),
        "frame": np.array([tag.frame for tag in tags], np.int64),
        "focal_px": np.array([tag.cost.focal_px for tag in tags]),
        "pose": np.array([pose.matrix[:3] for pose, _, _ in frozen]).reshape(-1, 3, 4),
        "z": np.array([z for _, z, _ in frozen]),
        "root": np.array([root.root[triangle] for _, _, root in frozen]),
        "cost": np.array([[root.cost, root.observations] for _, _, root in frozen]).reshape(-1, 2),
    }


def _views_from_arrays(
    arrays: Arrays, model: ObjectModel, noise: NoiseModel, camera: Camera
) -> Iterator[ObservationTag]:
    names = ("number", "frame", "focal_px", "pose", "z", "root", "cost", "is_frozen")
    views = views_from_arrays(_under("made_of_", arrays), model, camera)
    triangle: tuple[Ints, Ints] = np.triu_indices(7 + model.mode_count)
    for number, frame, focal_px, pose, z, packed, (cost, count), is_frozen in zip(
        *(arrays[name] for name in names), strict=True
    ):
        root = np.zeros((7 + model.mode_count,) * 2, order="F")
        root[triangle] = packed
        view = None if is_frozen else next(views)
        observation = ObservationCost(model, view, noise, float(focal_px))
        at = Pose.restored(np.vstack([pose, [0.0, 0.0, 0.0, 1.0]]))
        observation.restore(at, z, SquareRoot(root, float(cost), float(count)))
        yield ObservationTag(int(number), int(frame), observation)
