"""A smoother with all of its past as plain arrays, and back.

What is saved is linear: views over their relative poses, which stays true when the world is moved; all else about where
it is. A smoother that is to go on as the saved one does is one that was read back.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import O, Z

from meshslam.geometry import NoiseModel, ObjectModel, Pose, SquareRoot
from meshslam.geometry.arrays import Floats
from meshslam.localization.factors import CameraMemo, SeenObject, object_factor
from meshslam.localization.graph_archive import (
    Arrays,
    factor_of,
    rows_from_arrays,
    rows_of,
    rows_to_arrays,
    values_from_arrays,
    values_to_arrays,
)
from meshslam.localization.past import Past
from meshslam.localization.smoother import Smoother
from meshslam.localization.tags import RoadTag, ViewTag
from meshslam.localization.window import Entry

_IN_WINDOW, _IN_PAST, _LEFT_BEHIND = range(3)  # where a factor is; the last: in the window, of variables that are gone


def smoother_to_arrays(smoother: Smoother) -> Arrays:
    """All that a smoother with a past holds."""
    assert smoother.past is not None
    smoother.freeze_all()
    every = gtsam.Values(smoother.past.values)
    every.insert(smoother.window.values)
    placed = [(_IN_WINDOW if e.origin is not None else _LEFT_BEHIND, e) for e in smoother.window.entries]
    placed += [(_IN_PAST, e) for e in smoother.past.entries]
    others = [(place, e) for place, e in placed if not isinstance(e.tag, ViewTag)]
    arrays = {f"window_{k}": v for k, v in values_to_arrays(smoother.window.values).items()}
    arrays |= {f"past_{k}": v for k, v in values_to_arrays(smoother.past.values).items()}
    arrays |= {f"rows_{k}": v for k, v in rows_to_arrays([rows_of(e.factor, every) for _, e in others]).items()}
    arrays["rows_place"] = np.array([place for place, _ in others], np.int64)
    arrays["rows_road"] = np.array([e.tag.number if isinstance(e.tag, RoadTag) else -1 for _, e in others], np.int64)
    arrays |= _views_to_arrays([(place, e.tag) for place, e in placed if isinstance(e.tag, ViewTag)])
    return arrays | {f"frames_{k}": v for k, v in smoother.bookkeeping().items()}


def smoother_from_arrays(empty: Smoother, arrays: Mapping[str, Any], model: ObjectModel, noise: NoiseModel) -> None:
    """Fill a smoother that has not begun."""
    past = empty.past = Past(values_from_arrays(_under("past_", arrays)))
    empty.window.values = values_from_arrays(_under("window_", arrays))
    empty.keep_books(_under("frames_", arrays))
    every = gtsam.Values(past.values)
    every.insert(empty.window.values)
    rows = rows_from_arrays(_under("rows_", arrays))
    for place, road, linear in zip(arrays["rows_place"].tolist(), arrays["rows_road"].tolist(), rows, strict=True):
        held = factor_of(linear, every)
        tag = RoadTag(road) if road >= 0 else None
        entry = Entry(held, frozenset(linear.keys), tag, None if place == _LEFT_BEHIND else held)
        (past.entries if place == _IN_PAST else empty.window.entries).append(entry)
    for place, view in _views_from_arrays(_under("view_", arrays), model, noise):
        memo = CameraMemo(empty.arm_m, empty.rates_rad_s[view.frame])
        factor = object_factor(view.seen, empty.camera_keys(view.frame), memo, O(view.number), Z(view.number))
        entry = Entry(factor, frozenset(factor.keys()), view, factor)
        (past.entries if place == _IN_PAST else empty.window.entries).append(entry)
    empty.window.settle([e for e in empty.window.entries if isinstance(e.tag, ViewTag)])


def _under(prefix: str, arrays: Mapping[str, Any]) -> Arrays:
    return {key.removeprefix(prefix): value for key, value in arrays.items() if key.startswith(prefix)}


def _views_to_arrays(views: list[tuple[int, ViewTag]]) -> Arrays:
    frozen = [tag.seen.frozen for _, tag in views]
    return {
        "view_place": np.array([place for place, _ in views], np.int64),
        "view_number": np.array([tag.number for _, tag in views], np.int64),
        "view_frame": np.array([tag.frame for _, tag in views], np.int64),
        "view_pose": np.array([pose.matrix for pose, _, _ in frozen]),
        "view_z": np.array([z for _, z, _ in frozen]),
        "view_root": np.array([root.root for _, _, root in frozen]),
        "view_observations": np.array([root.observations for _, _, root in frozen]),
        "view_focal_px": np.array([tag.seen.focal_px for _, tag in views]),
    }


def _views_from_arrays(arrays: Arrays, model: ObjectModel, noise: NoiseModel) -> list[tuple[int, ViewTag]]:
    views = []
    columns = ("place", "number", "frame", "pose", "z", "root", "observations", "focal_px")
    for place, number, frame, pose, z, root, observations, focal_px in zip(*(arrays[c] for c in columns), strict=True):
        cost = 0.5 * float(np.square(root[:, -1]).sum())
        linear: Floats = np.asfortranarray(root)
        seen = SeenObject(model, None, noise, float(focal_px))
        seen.restore(Pose.from_matrix(pose), z, SquareRoot(linear, cost, float(observations)))
        views.append((int(place), ViewTag(int(number), int(frame), seen)))
    return views
