"""From a fitted path to an object of the map: its own mesh, its path at the mesh's centre, and their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshslam.geometry import Floats, ObjectState, Pose, View, hat
from meshslam.maps import MapObject, MovingObject, MovingPath
from meshslam.moving.fit import PathFit, centre_of, nearest_detection, relative_cameras
from meshslam.moving.path_state import NODE_WIDTH, PathState
from meshslam.moving.solver import covariances
from meshslam.objects import Occluders, Scene, make_views


@dataclass(frozen=True, eq=False)
class Shaped:
    """The object with its own shape, held still at one detection; the cameras move instead."""

    views: list[View]
    state: ObjectState
    reference: int  # the detection at which world_from_object is the path's
    mask_ious: Floats  # one a view


def with_own_shape(fit: PathFit, scene: Scene, occluders: Occluders) -> Shaped:
    """Free form by the observation model of what stands: the path tells where each camera was.

    The modes stay: what is known of the object's size is in the path's fit alone.
    """
    reference = nearest_detection(fit.track, fit.state)
    at = fit.state.poses[reference]
    cameras = tuple(at @ camera for camera in relative_cameras(fit.track, fit.state))
    still = replace(fit.track, world_from_camera=cameras).subset(fit.chosen)
    made = make_views(
        still, scene.model, scene.category, scene.keypoint_names, scene.camera, occluders.before, scene.config
    )
    views = [view.with_surface_sigma(sigma) for view, sigma in zip(made, fit.surface_px, strict=True)]
    state = replace(scene.model.state_at(at), z=fit.state.z)
    if len(views) >= scene.config.free_form_views:
        ground, noise = scene.ground_at(at.translation), scene.config.noise
        state = scene.model.refine(views, ground, noise, state, modes=False, free_form=True).state
    ious = scene.model.mask_ious(views, [state.world_from_object], scene.model.vertices(state))[0]
    return Shaped(views, state, reference, ious)


def moving_object(fit: PathFit, shaped: Shaped, scene: Scene) -> MovingObject:
    """What the map holds; GeometryError where nothing holds a parameter."""
    vertices = scene.model.vertices(shaped.state)
    centre = centre_of(vertices)
    # the shape's fit may move the object in its own frame; it does so at all times
    moved = fit.state.poses[shaped.reference].inverse() @ shaped.state.world_from_object
    own = moved @ Pose(np.eye(3), centre)
    poses = tuple(pose @ own for pose in fit.state.poses)
    path = _path(fit, poses, own, _centre_by_modes(scene, fit.state.z))
    return MovingObject(
        _body(fit, shaped, scene, poses, path, vertices - centre), float(path.times_s[shaped.reference]), path
    )


def _body(
    fit: PathFit, shaped: Shaped, scene: Scene, poses: tuple[Pose, ...], path: MovingPath, vertices: Floats
) -> MapObject:
    track, noise = fit.track, scene.config.noise
    ground = scene.ground_at(shaped.state.world_from_object.translation)
    _, sigma, seen = scene.model.uncertainty(
        shaped.views, ground, noise, shaped.state, modes=True, free_form=True, per_vertex=True
    )
    frames = [d.frame for d in track.detections]
    keypoints = scene.category.keypoints(vertices)
    return MapObject(
        id=track.id,
        category=scene.category.name,
        world_from_object=poses[shaped.reference],
        vertices=vertices,
        faces=scene.model.faces,
        views=len(frames),
        first_frame=min(frames),
        last_frame=max(frames),
        mask_iou=float(shaped.mask_ious.mean()),
        keypoints=dict(zip(scene.category.keypoint_names, keypoints, strict=True)),
        pose_covariance=path.covariances[shaped.reference],
        vertex_sigma_m=np.hypot(sigma, _sigmas_by_modes(fit, scene)),
        vertex_observed=seen,
    )


def _path(fit: PathFit, poses: tuple[Pose, ...], own: Pose, centre_by_modes: Floats) -> MovingPath:
    """The path of the mesh's centre, by the joint covariance of each pose with the shape."""
    joint, _ = covariances(fit.problem, fit.at)
    state, modes = fit.state, len(fit.state.z) if fit.problem.modes else 0
    step = np.zeros((6, NODE_WIDTH + modes))
    turned = own.rotation.T  # the steps are in the path's frame, the covariance in the object's
    step[:3, :3], step[:3, 3:6], step[3:, 3:6] = turned, -turned @ hat(own.translation), turned
    step[:3, NODE_WIDTH:] = turned @ centre_by_modes[:, :modes]
    rates = np.column_stack([state.curvatures, state.speeds_m_s])  # of speed * curvature over both
    driven = joint[:, 6:8, 6:8]
    return MovingPath(
        fit.track.times_s,
        tuple(d.frame for d in fit.track.detections),
        poses,
        step @ joint @ step.T,
        _velocities(state, fit.problem.driving.rear_axle_m, own.translation),
        state.speeds_m_s,
        np.sqrt(driven[:, 0, 0]),
        state.turn_rates_rad_s,
        np.sqrt(np.einsum("ni,nij,nj->n", rates, driven, rates)),
    )


def _velocities(state: PathState, rear_axle_m: float, centre: Floats) -> Floats:
    """Velocities (n, 3) in world of the centre, which swings about the rear axle."""
    arm = centre - [rear_axle_m, 0.0, 0.0]
    in_object = np.zeros((len(state), 3))
    in_object[:, 0] = state.speeds_m_s
    in_object += np.cross(np.array([0.0, 0.0, 1.0]), arm) * state.turn_rates_rad_s[:, None]
    found: Floats = (state.rotations @ in_object[..., None])[..., 0]
    return found


def _centre_by_modes(scene: Scene, z: Floats) -> Floats:
    """Derivative (3, modes) of the bounding box's centre."""
    category = scene.category
    vertices, axes = category.shape(z), np.arange(3)
    low, high = vertices.argmin(0), vertices.argmax(0)
    by_modes: Floats = 0.5 * (category.modes[:, low, axes] + category.modes[:, high, axes]).T
    return by_modes


def _sigmas_by_modes(fit: PathFit, scene: Scene) -> Floats:
    """Standard deviation (V,) of each vertex, root mean square over the axes, by what the path leaves open of modes."""
    if not fit.problem.modes:
        return np.zeros(len(scene.category.vertices))
    _, shape = covariances(fit.problem, fit.at)
    modes = scene.category.modes
    squares: Floats = np.einsum("mvi,mk,kvi->v", modes, shape, modes, optimize=True) / 3
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)), float)
