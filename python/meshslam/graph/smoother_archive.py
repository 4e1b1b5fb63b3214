"""A smoother with its history as plain arrays, and back.

What is saved is linear: views over their relative poses, which stays true when the world is moved; all else about where
it is. A smoother that is to go on as the saved one does is one that was read back.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import O, Z

from meshslam.geometry import Floats, NoiseModel, ObjectModel, Pose, SquareRoot
from meshslam.graph.full_trajectory import History
from meshslam.graph.graph_archive import (
    Arrays,
    factor_of,
    rows_from_arrays,
    rows_of,
    rows_to_arrays,
    values_from_arrays,
    values_to_arrays,
)
from meshslam.graph.object_factor import CameraMemo, ObservationCost
from meshslam.graph.smoother import Smoother
from meshslam.graph.tags import DISPLACEMENT, ObservationTag, PointTag, RoadTag
from meshslam.graph.view_terms import ViewTerm, view_factor
from meshslam.graph.window import Entry

_IN_WINDOW, _IN_HISTORY, _LEFT_BEHIND = range(
    3
)  # where a factor is; the last: in the window, of variables that are gone


def smoother_to_arrays(smoother: Smoother) -> Arrays:
    """All that a smoother with a history holds."""
    assert smoother.history is not None
    smoother.objects.freeze()
    every = gtsam.Values(smoother.history.values)
    every.insert(smoother.window.values)
    placed = [(_IN_WINDOW if e.origin is not None else _LEFT_BEHIND, e) for e in smoother.window.entries]
    placed += [(_IN_HISTORY, e) for e in smoother.history.entries]
    others = [(place, e) for place, e in placed if not isinstance(e.tag, ObservationTag)]
    arrays = {f"window_{k}": v for k, v in values_to_arrays(smoother.window.values).items()}
    arrays |= {f"past_{k}": v for k, v in values_to_arrays(smoother.history.values).items()}
    arrays |= {f"rows_{k}": v for k, v in rows_to_arrays([rows_of(e.factor, every) for _, e in others]).items()}
    arrays["rows_place"] = np.array([place for place, _ in others], np.int64)
    arrays["rows_tag"] = np.array([_tag_to_plain(e.tag) for _, e in others], np.int64).reshape(-1, 3)
    arrays |= _views_to_arrays([(place, e.tag) for place, e in placed if isinstance(e.tag, ObservationTag)])
    return arrays | {f"frames_{k}": v for k, v in (smoother.cameras.to_arrays() | smoother.objects.to_arrays()).items()}


def smoother_from_arrays(empty: Smoother, arrays: Mapping[str, Any], model: ObjectModel, noise: NoiseModel) -> None:
    """Fill a smoother that has not begun."""
    history = empty.history = History(values_from_arrays(_under("past_", arrays)))
    empty.window.values = values_from_arrays(_under("window_", arrays))
    tables = _under("frames_", arrays)
    empty.cameras.fill(tables)
    empty.objects.fill(tables)
    every = gtsam.Values(history.values)
    every.insert(empty.window.values)
    rows = rows_from_arrays(_under("rows_", arrays))
    for place, plain, linear in zip(arrays["rows_place"].tolist(), arrays["rows_tag"].tolist(), rows, strict=True):
        held = factor_of(linear, every)
        entry = Entry(held, frozenset(linear.keys), _tag(plain), None if place == _LEFT_BEHIND else held)
        (history.entries if place == _IN_HISTORY else empty.window.entries).append(entry)
    for place, view in _views_from_arrays(_under("view_", arrays), model, noise):
        memo = CameraMemo(empty.cameras.arm_m, empty.cameras.rates_rad_s[view.frame])
        term = ViewTerm(view.cost, empty.cameras.keys(view.frame), memo, O(view.number), Z(view.number))
        factor = view_factor(term)
        entry = Entry(factor, frozenset(term.keys), view, factor, term, term)
        (history.entries if place == _IN_HISTORY else empty.window.entries).append(entry)
    empty.window.settle([e for e in empty.window.entries if isinstance(e.tag, ObservationTag)])


def _tag_to_plain(tag: object) -> tuple[int, int, int]:
    """What a factor belongs to: its kind and two numbers."""
    if isinstance(tag, RoadTag):
        return 1, tag.number, 0
    if isinstance(tag, PointTag):
        return 2, tag.row, tag.first
    return (3, 0, 0) if tag == DISPLACEMENT else (0, 0, 0)


def _tag(plain: list[int]) -> object:
    kind, one, other = plain
    return [None, RoadTag(one), PointTag(one, other), DISPLACEMENT][kind]


def _under(prefix: str, arrays: Mapping[str, Any]) -> Arrays:
    return {key.removeprefix(prefix): value for key, value in arrays.items() if key.startswith(prefix)}


def _views_to_arrays(views: list[tuple[int, ObservationTag]]) -> Arrays:
    frozen = [tag.cost.frozen for _, tag in views]
    return {
        "view_place": np.array([place for place, _ in views], np.int64),
        "view_number": np.array([tag.number for _, tag in views], np.int64),
        "view_frame": np.array([tag.frame for _, tag in views], np.int64),
        "view_pose": np.array([pose.matrix for pose, _, _ in frozen]),
        "view_z": np.array([z for _, z, _ in frozen]),
        "view_root": np.array([root.root for _, _, root in frozen]),
        "view_observations": np.array([root.observations for _, _, root in frozen]),
        "view_focal_px": np.array([tag.cost.focal_px for _, tag in views]),
    }


def _views_from_arrays(arrays: Arrays, model: ObjectModel, noise: NoiseModel) -> list[tuple[int, ObservationTag]]:
    views = []
    columns = ("place", "number", "frame", "pose", "z", "root", "observations", "focal_px")
    for place, number, frame, pose, z, root, observations, focal_px in zip(*(arrays[c] for c in columns), strict=True):
        cost = 0.5 * float(np.square(root[:, -1]).sum())
        linear: Floats = np.asfortranarray(root)
        observation = ObservationCost(model, None, noise, float(focal_px))
        observation.restore(Pose.from_matrix(pose), z, SquareRoot(linear, cost, float(observations)))
        views.append((int(place), ObservationTag(int(number), int(frame), observation)))
    return views
