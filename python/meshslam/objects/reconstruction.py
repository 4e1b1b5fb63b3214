"""One object from the views of its track: start, pose, modes, free form (paper, Sec. IV-C; DESIGN, "Shape")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Bools, Camera, Floats, GroundPlane, NoiseModel, ObjectModel, ObjectState, Pose, View
from meshslam.objects.config import ObjectConfig
from meshslam.objects.ground import ground_near
from meshslam.objects.heading import heading_cost
from meshslam.objects.start_search import (
    flipped,
    pose_from_keypoints,
    rough_position,
    search_poses,
    triangulate_keypoints,
    upright,
    yaw_starts,
)
from meshslam.objects.track import Track

_NEAREST_M = 1.0  # depth of an object's centre below which its image says no more of its depth


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """The estimate of an object, with its intermediate stages."""

    start: ObjectState  # the mean mesh at its first estimate
    posed: ObjectState  # the mean mesh after the pose step
    modes: ObjectState  # with the category's modes
    state: ObjectState  # the last: with modes, or with free form too
    ground: GroundPlane | None
    cost: float


@dataclass(frozen=True, eq=False)
class TrackObservations:
    """A track with its observations, and the few of them that the search of the start uses."""

    track: Track
    views: list[View]
    start_track: Track
    start_views: list[View]
    surface_sigmas_px: tuple[float, ...] | None = None  # of the views, where they were given one


@dataclass(frozen=True, eq=False)
class Scene:
    """What all objects of one category in a sequence share."""

    camera: Camera
    category: Category
    model: ObjectModel
    keypoint_names: tuple[str, ...]  # in the order of the detections
    points_on_road: Floats | None  # (n, 3); None: the road is not used
    config: ObjectConfig

    def ground_at(self, position: Floats) -> GroundPlane | None:
        """The road near a position."""
        return None if self.points_on_road is None else ground_near(self.points_on_road, position, self.config)


def coarse(noise: NoiseModel) -> NoiseModel:
    """The noise model of the search: fewer samples, errors of pixels forgiven, far borders still felt."""
    return replace(noise, outline_step_px=2 * noise.outline_step_px, border_sigma_px=2 * noise.border_sigma_px)


def find_start(observed: TrackObservations, scene: Scene) -> list[tuple[float, Pose]]:
    """Poses of the mean mesh to start from, the best first: from key points, else drawn at headings on the road."""
    config = scene.config
    points = triangulate_keypoints(observed.track, scene.keypoint_names, scene.category, scene.camera, config)
    from_points = pose_from_keypoints(points, scene.category)
    found: list[tuple[float, Pose]] = []
    if from_points is not None:
        ground = scene.ground_at(from_points.translation)
        placed = [upright(from_points, ground), from_points]
        found = search_poses(scene.model, observed.start_views, placed, ground, coarse(config.noise), 2)
        if _overlap(observed, scene, found[0][1]) >= config.start_overlap:
            return found
    position = rough_position(observed.track, scene.category, scene.camera)
    found += _search_headings(observed, scene, position if from_points is None else from_points.translation)
    return sorted(found, key=lambda pair: pair[0])


def _overlap(observed: TrackObservations, scene: Scene, pose: Pose) -> float:
    """Mask IoU of the mean mesh, mean over the views of the search."""
    vertices = scene.model.vertices(scene.model.state_at(pose))
    return float(scene.model.mask_ious(observed.start_views, [pose], vertices).mean())


def _search_headings(observed: TrackObservations, scene: Scene, position: Floats) -> list[tuple[float, Pose]]:
    track, config = observed.start_track, scene.config
    ground = scene.ground_at(position)
    nearest = int(np.argmax([d.bbox[3] for d in track.detections]))
    eye = track.world_from_camera[nearest].translation
    starts = yaw_starts(position, ground, scene.category, config.start_yaws, eye)
    views, noise = observed.start_views, coarse(config.noise)
    return search_poses(scene.model, views, starts, ground, noise, config.start_candidates)


def reconstruct(observed: TrackObservations, scene: Scene, start: Pose | None = None) -> Reconstruction:
    """Start, pose, modes: the best start and another, each also turned by half a turn, are refined while they may win.

    A start that is known is the only one; it is tried turned by half a turn, too.
    """
    starts = [pose for _, pose in find_start(observed, scene)] if start is None else [start]
    best = starts[0]
    others = [pose for pose in starts[1:] if _differs(pose, best)][:1]
    both_ways = [turned for pose in (best, *others) for turned in (pose, flipped(pose))]
    return cheapest(fit_modes(observed, scene, both_ways), observed.track)


def cheapest(candidates: Sequence[Reconstruction], track: Track) -> Reconstruction:
    """The reconstruction that residuals and the viewing angles of the detections speak for."""
    return min(candidates, key=lambda r: r.cost + heading_cost(track, r.state.world_from_object))


def _differs(pose: Pose, other: Pose) -> bool:
    """Whether two poses are other places or headings, a flip apart from each other counting as the same."""
    across = abs(float(pose.rotation[:, 0] @ other.rotation[:, 0]))
    return across < 0.9 or float(np.linalg.norm(pose.translation - other.translation)) > 1.0


def fit_modes(observed: TrackObservations, scene: Scene, starts: Sequence[Pose]) -> list[Reconstruction]:
    """From each start first the pose, then pose and modes; a pose that costs far more than another goes no further."""
    model, noise, views = scene.model, scene.config.noise, observed.views
    posed = []
    for start in starts:
        at_start = model.state_at(start)
        ground = scene.ground_at(start.translation)
        posed.append((at_start, model.refine(views, ground, noise, at_start, modes=False, free_form=False)))
    least = min(refined.cost for _, refined in posed)
    most = (1 + scene.config.start_margin_share) * least + scene.config.start_margin
    found = []
    for at_start, at in posed:
        if at.cost <= most:
            ground = scene.ground_at(at.state.world_from_object.translation)
            shaped = model.refine(views, ground, noise, at.state, modes=True, free_form=False)
            found.append(Reconstruction(at_start, at.state, shaped.state, shaped.state, ground, shaped.cost))
    return found


def fit_free_form(observed: TrackObservations, scene: Scene, found: Reconstruction) -> Reconstruction:
    """Pose, modes and free form together; from one or two views free form follows outlines that nothing confirms."""
    if len(observed.views) < scene.config.free_form_views:
        return found
    noise = scene.config.noise
    refined = scene.model.refine(observed.views, found.ground, noise, found.state, modes=True, free_form=True)
    return replace(found, state=refined.state, cost=refined.cost)


def refit(observed: TrackObservations, scene: Scene, found: Reconstruction) -> Reconstruction:
    """Fit once more from where the object was, with views that know more of what hides it."""
    ground = scene.ground_at(found.state.world_from_object.translation)
    noise, model = scene.config.noise, scene.model
    again = model.refine(observed.views, ground, noise, found.state, modes=True, free_form=False)
    return replace(found, modes=again.state, state=again.state, ground=ground, cost=again.cost)


@dataclass(frozen=True, eq=False)
class Centred:
    """A state as a mesh whose origin is the centre of its bounding box."""

    world_from_object: Pose
    vertices: Floats


def centred(model: ObjectModel, state: ObjectState) -> Centred:
    """Move the object's origin to the centre of its bounding box."""
    vertices = model.vertices(state)
    centre = (vertices.max(0) + vertices.min(0)) / 2
    pose = state.world_from_object
    return Centred(Pose(pose.rotation, pose.transform(centre)), vertices - centre)


def with_surface_error(observed: TrackObservations, scene: Scene, state: ObjectState) -> TrackObservations:
    """The same views, each with the surface's error as it is seen from there.

    It is set once for a fit: a weight that followed the depth would pull the object towards the camera.
    """
    at, poses = state.world_from_object.translation, observed.track.world_from_camera
    depths = [max(_NEAREST_M, float(pose.inverse().transform(at)[2])) for pose in poses]
    surface_px = scene.config.noise.surface_sigma_m * scene.camera.fx
    return with_surface_sigmas(observed, tuple(surface_px / z for z in depths))


def with_surface_sigmas(observed: TrackObservations, sigmas_px: tuple[float, ...]) -> TrackObservations:
    """The same views, each with a standard deviation of the surface, pixels."""
    views = [view.with_surface_sigma(sigma) for view, sigma in zip(observed.views, sigmas_px, strict=True)]
    return replace(observed, views=views, surface_sigmas_px=sigmas_px)


def uncertainty(
    observed: TrackObservations, scene: Scene, found: Reconstruction, *, per_vertex: bool = True
) -> tuple[Floats, Floats, Bools]:
    """Covariance of the pose at the mesh's centre, sigma of each vertex if asked for, which vertices were observed."""
    model, noise, views = scene.model, scene.config.noise, observed.views
    return model.uncertainty(views, found.ground, noise, found.state, modes=True, free_form=True, per_vertex=per_vertex)


def motion(observed: TrackObservations, scene: Scene, found: Reconstruction) -> tuple[Floats, float]:
    """Velocity (3,) in the world, m/s, that explains the views best, and by how much the cost falls with it.

    The cost is half a squared Mahalanobis distance: a fall by 10 says as much as one observation 4.5 sigmas off.
    """
    model, noise, views = scene.model, scene.config.noise, observed.views
    moving = model.refine(views, found.ground, noise, found.state, modes=True, free_form=False, velocity=True)
    stopped = replace(moving.state, velocity=np.zeros(3))
    still = model.refine(views, found.ground, noise, stopped, modes=True, free_form=False)
    return moving.state.velocity, min(still.cost, found.cost) - moving.cost


def height_over_road_m(scene: Scene, found: Reconstruction) -> tuple[float, float]:
    """Height of the mesh's lowest point over the road near it, and that road's sigma; 0 where the road is not used."""
    mesh = centred(scene.model, found.state)
    ground = scene.ground_at(mesh.world_from_object.translation)
    if ground is None:
        return 0.0, 1.0
    lowest = mesh.vertices[np.argmin(mesh.vertices[:, 2])]
    return ground.height_m(mesh.world_from_object.transform(lowest)), ground.height_sigma_m
