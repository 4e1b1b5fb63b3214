"""Path and shape of one object that drives, from the views of its track."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshslam.geometry import Floats, ObjectState, Pose, View
from meshslam.moving.config import MovingConfig
from meshslam.moving.driving import Driving
from meshslam.moving.path_state import PathState
from meshslam.moving.problem import Linearized, PathProblem
from meshslam.moving.road_contact import Contacts, RoadContact
from meshslam.moving.shape_prior import ShapePrior
from meshslam.moving.solver import solve
from meshslam.moving.start import reversed_state, state_from_boxes, state_from_velocity
from meshslam.objects import Occluders, Scene, Track, TrackObservations, choose_views, heading_cost, make_views

_NEAREST_M = 1.0
_SPREAD = 2  # starts whose shape is fitted, too


@dataclass(frozen=True, eq=False)
class PathFit:
    """A path and a shape that explain the views of a track."""

    track: Track  # every detection
    chosen: tuple[int, ...]  # of them, whose views are used
    surface_px: tuple[float, ...]  # of each view, standard deviation of the surface
    problem: PathProblem
    at: Linearized

    @property
    def state(self) -> PathState:
        """The estimate."""
        return self.at.state


def fit_path(
    track: Track,
    standing: ObjectState,
    observed: TrackObservations,
    scene: Scene,
    occluders: Occluders,
    config: MovingConfig,
    shapes: ShapePrior,
) -> PathFit:
    """From the best of several starts: poses first, then poses and shape.

    `standing` is the fit as of an object that stands, from `observed`, which have their views.
    """
    fitting = _Fitting.of(track, scene, occluders, config, shapes)
    starts = [replace(state, z=shapes.mean) for state in _starts(track, standing, observed, scene)]
    posed = [fitting.fitted(start, modes=False) for start in starts]
    posed.sort(key=lambda fit: fit.at.cost + fitting.heading_cost(fit))
    shaped = [fitting.fitted(fit.state, modes=True) for fit in posed[:_SPREAD]]
    return min(shaped, key=lambda fit: fit.at.cost + fitting.heading_cost(fit))


def refit_path(
    track: Track,
    start: PathState,
    scene: Scene,
    occluders: Occluders,
    config: MovingConfig,
    shapes: ShapePrior,
) -> PathFit:
    """Once more from a state, with the road below it, and what else is known of shapes by then."""
    return _Fitting.of(track, scene, occluders, config, shapes).fitted(start, modes=True)


def _starts(track: Track, standing: ObjectState, observed: TrackObservations, scene: Scene) -> list[PathState]:
    """As the motion test has it, and as the boxes have it; each both ways."""
    noise, pose = scene.config.noise, standing.world_from_object
    ground = scene.ground_at(pose.translation)
    moved = scene.model.refine(
        observed.views, ground, noise, standing, modes=True, free_form=False, velocity=True
    ).state
    middle = float(observed.track.times_s.mean())
    straight = state_from_velocity(track, moved.world_from_object, moved.velocity, middle, scene.model.mode_count)
    boxes = state_from_boxes(track, scene, moved.world_from_object.yaw_rad)
    found = [straight] if boxes is None else [straight, boxes]
    return [way for state in found for way in (state, reversed_state(state))]


@dataclass(frozen=True, eq=False)
class _Fitting:
    """What all fits of one track share."""

    track: Track
    chosen: tuple[int, ...]
    views: Sequence[View]
    scene: Scene
    config: MovingConfig
    contacts: Contacts | None
    driving: Driving
    shapes: ShapePrior

    @staticmethod
    def of(track: Track, scene: Scene, occluders: Occluders, config: MovingConfig, shapes: ShapePrior) -> _Fitting:
        chosen = tuple(choose_views(track, config.max_views, scene.config))
        seen = track.subset(chosen)
        views = make_views(
            seen, scene.model, scene.category, scene.keypoint_names, scene.camera, occluders.before, scene.config
        )
        contacts = Contacts.of(scene.category)
        driving = Driving(np.diff(track.times_s), _rear_axle_m(scene), config)
        return _Fitting(track, chosen, views, scene, config, contacts, driving, shapes)

    def fitted(self, start: PathState, *, modes: bool) -> PathFit:
        """The road and what the surface may be off are taken as they are at the start."""
        surface_px = tuple(self._surface_px(start))
        views = tuple(view.with_surface_sigma(sigma) for view, sigma in zip(self.views, surface_px, strict=True))
        cameras = tuple(self.track.world_from_camera[i] for i in self.chosen)
        problem = PathProblem(
            self.scene.model,
            self.scene.config.noise,
            views,
            self.chosen,
            cameras,
            self.driving,
            self._road(start),
            self.shapes,
            modes,
        )
        return PathFit(self.track, self.chosen, surface_px, problem, solve(problem, start))

    def heading_cost(self, fit: PathFit) -> float:
        """What the detections' viewing angles say: the cameras as they are seen from the object."""
        cameras = relative_cameras(self.track, fit.state)
        return heading_cost(replace(self.track, world_from_camera=cameras), Pose.identity())

    def _surface_px(self, state: PathState) -> list[float]:
        poses = [self.track.world_from_camera[i].inverse() for i in self.chosen]
        depths = [float(p.transform(state.translations[i])[2]) for p, i in zip(poses, self.chosen, strict=True)]
        surface_px = self.scene.config.noise.surface_sigma_m * self.scene.camera.fx
        return [surface_px / max(_NEAREST_M, z) for z in depths]

    def _road(self, state: PathState) -> RoadContact | None:
        planes = [self.scene.ground_at(place) for place in state.translations]
        known = [plane for plane in planes if plane is not None]
        if self.contacts is None or len(known) < len(planes):
            return None
        return RoadContact.below(self.contacts, known, state, self.config.road_correlation_m)


def relative_cameras(track: Track, state: PathState) -> tuple[Pose, ...]:
    """object_from_camera of every detection."""
    pairs = zip(state.poses, track.world_from_camera, strict=True)
    return tuple(world_from_object.inverse() @ camera for world_from_object, camera in pairs)


def _rear_axle_m(scene: Scene) -> float:
    """Return x of the rear wheels, in object; the object's middle where there are no wheels."""
    x = scene.category.vertices[scene.category.wheel_vertices, 0]
    behind = x[x < x.mean()] if len(x) else x
    return float(behind.mean()) if len(behind) else 0.0


def nearest_detection(track: Track, state: PathState) -> int:
    """The detection that shows the object from the least distance."""
    away = [pose.translation for pose in track.world_from_camera]
    return int(np.argmin(np.linalg.norm(np.array(away) - state.translations, axis=1)))


def centre_of(vertices: Floats) -> Floats:
    """Centre (3,) of the bounding box."""
    middle: Floats = (vertices.max(0) + vertices.min(0)) / 2
    return middle
