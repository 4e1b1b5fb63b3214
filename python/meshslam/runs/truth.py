"""A run against the truth, which is opened once the run's own path and map are on disk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from meshslam.evaluation import Truth, match_objects, nearest_in_time, read_truth, score_object, trajectory_figures
from meshslam.geometry import Floats, Pose
from meshslam.maps import Map, Trajectory
from meshslam.sequences import Sequence
from meshslam.viewing import TrueObject


def paths_against_truth(recording: Sequence, paths: Mapping[str, tuple[Pose, ...] | Trajectory]) -> dict[str, float]:
    """`ate_<name>_rmse_m` of each path, its poses being those of the frames; empty without truth."""
    truth = read_truth(recording.root).path
    if truth is None:
        return {}
    found = {
        name: trajectory_figures(truth, path if isinstance(path, Trajectory) else Trajectory(recording.times_s, path))
        for name, path in paths.items()
        if len(path)
    }
    return {f"ate_{name}_rmse_m": rows["ate_rmse_m"] for name, rows in found.items() if "ate_rmse_m" in rows}


@dataclass(frozen=True, eq=False)
class ShownTruth:
    """What a report shows of the truth; empty where there is none."""

    path: dict[str, tuple[Pose, ...]] = field(default_factory=dict)  # under its name
    objects: tuple[TrueObject, ...] = ()
    errors: dict[str, Floats] = field(default_factory=dict)  # by path: (n, 2), m and degrees, NaN where not known


def shown_truth(recording: Sequence, scene: Map | None, paths: Mapping[str, tuple[Pose, ...]]) -> ShownTruth:
    """The truth beside a recording; `scene` is a map that was made, `paths` have one pose a frame."""
    truth = read_truth(recording.root)
    if truth.path is None:
        return ShownTruth(objects=_true_objects(truth, scene))
    errors = {name: _errors(truth.path, recording.times_s, path) for name, path in paths.items() if path}
    known = {name: rows for name, rows in errors.items() if np.isfinite(rows).any()}
    return ShownTruth({"truth": truth.path.world_from_camera}, _true_objects(truth, scene), known)


def _errors(truth: Trajectory, times_s: Floats, path: tuple[Pose, ...]) -> Floats:
    """Distance, m, and angle, degrees, of each pose (n, 2) to the true one at its time; NaN where there is none."""
    nearest, found = nearest_in_time(times_s, truth.times_s)
    rows = np.full((len(path), 2), np.nan)
    for i in np.flatnonzero(found).tolist():
        true_from_estimated = truth.world_from_camera[nearest[i]].inverse() @ path[i]
        cosine = (np.trace(true_from_estimated.rotation) - 1) / 2
        rows[i] = np.linalg.norm(true_from_estimated.translation), np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return rows


def _true_objects(truth: Truth, scene: Map | None) -> tuple[TrueObject, ...]:
    if truth.objects is None or scene is None:
        return ()
    scores = {true.id: score_object(true, found) for true, found in match_objects(truth.objects, scene)}
    shown = []
    for thing in truth.objects.objects:
        place, score = (thing.world_from_object, thing.vertices, thing.faces), scores.get(thing.id)
        error = (
            () if score is None else (score.estimated_id, score.centre_error_m, score.yaw_error_deg, score.voxel_iou)
        )
        shown.append(TrueObject(thing.id, *place, *error))
    return tuple(shown)
