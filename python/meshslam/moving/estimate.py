"""One object that drives, from its track to the map; or why it does not become one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import ObjectState
from meshslam.maps import MovingObject
from meshslam.moving.config import MovingConfig
from meshslam.moving.finish import moving_object, with_own_shape
from meshslam.moving.fit import PathFit, fit_path, refit_path
from meshslam.moving.path_state import PathState
from meshslam.moving.shape_prior import ShapeEvidence, ShapePrior
from meshslam.moving.solver import covariances
from meshslam.objects import Occluders, Scene, Track, TrackObservations


@dataclass(frozen=True, eq=False)
class Estimated:
    """A moving object, or the reason why the track is none, with figures."""

    object: MovingObject | None
    doubt: str = ""


@dataclass(frozen=True)
class PathBounds:
    """What a path must reach to be believed."""

    gain: float  # by which it costs less than one place
    mask_iou: float  # mean over its views


@dataclass(frozen=True, eq=False)
class Begun:
    """A track's first path, without its views, and what it tells of the shapes of a drive's objects."""

    track: Track
    standing: ObjectState  # the best fit as of an object in one place
    state: PathState | None  # None: there is no path, and `doubt` says why
    shape: ShapeEvidence | None = None
    doubt: str = ""


def begin_moving(
    track: Track,
    standing: ObjectState,
    observed: TrackObservations,
    scene: Scene,
    occluders: Occluders,
    config: MovingConfig,
    shapes: ShapePrior,
) -> Begun:
    """The path of a track that may not fit an object in one place; `standing` is the best such fit."""
    if len(track.detections) < config.min_views or (np.diff(track.times_s) <= 0).any():
        few = f"{len(track.detections)} views of {config.min_views} needed for a path"
        return Begun(track, standing, None, doubt=few)
    try:
        fit = fit_path(track, standing, observed, scene, occluders, config, shapes)
        _, covariance = covariances(fit.problem, fit.at)
    except GeometryError as error:
        return Begun(track, standing, None, doubt=f"its path cannot be solved: {error}")
    return Begun(track, standing, fit.state, shapes.evidence(fit.state.z, covariance))


def finish_moving(
    begun: Begun,
    scene: Scene,
    occluders: Occluders,
    config: MovingConfig,
    shapes: ShapePrior,
    needed: PathBounds,
) -> Estimated:
    """Path and mesh with what the drive's other objects tell of shapes; or why it is no moving object."""
    if begun.state is None:
        return Estimated(None, begun.doubt)
    try:
        fit = refit_path(begun.track, begun.state, scene, occluders, config, shapes)
        found = moving_object(fit, with_own_shape(fit, scene, occluders), scene)
        gain = _standing_cost(fit, begun.standing, scene) - fit.at.cost
    except GeometryError as error:
        return Estimated(None, f"its path cannot be solved: {error}")
    doubt = _doubt(found, gain, config, needed)
    return Estimated(None, doubt) if doubt else Estimated(found)


def _standing_cost(fit: PathFit, standing: ObjectState, scene: Scene) -> float:
    """The cost of the same views with an object in one place: from the fit as such, and from the path's middle."""
    views, noise, model = fit.problem.views, scene.config.noise, scene.model
    middle = fit.state.poses[len(fit.state) // 2]
    starts = [standing, replace(model.state_at(middle), z=fit.state.z)]
    costs = []
    for start in starts:
        ground = scene.ground_at(start.world_from_object.translation)
        costs.append(model.refine(views, ground, noise, start, modes=True, free_form=False).cost)
    return min(costs)


def _doubt(found: MovingObject, gain: float, config: MovingConfig, needed: PathBounds) -> str:
    """Why the path is not to be believed; empty if it is."""
    path, overlap = found.path, found.body.mask_iou or 0.0
    way = float(np.linalg.norm(path.positions_in_world[-1] - path.positions_in_world[0]))
    certain = float((np.abs(path.speeds_m_s) / path.speed_sigmas_m_s).max())
    if overlap < needed.mask_iou:
        return f"its path does not fit its masks: mean mask IoU {overlap:.2f}"
    if path.mean_speed_m_s < config.min_speed_m_s or way < config.min_way_m:
        return f"its path is too short to be told from one place: {way:.1f} m at {path.mean_speed_m_s:.1f} m/s"
    if certain < config.min_speed_sigmas:
        return f"its speed is not certain: {path.mean_speed_m_s:.1f} m/s is at most {certain:.1f} sigmas"
    if gain < needed.gain:
        return f"its views agree as well with one place: cost lower by {gain:.0f} on the path"
    return ""
