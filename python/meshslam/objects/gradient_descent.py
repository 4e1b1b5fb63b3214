"""The paper's solver: gradient descent over an object's pose, then over its vertices (paper, Sec. IV-C)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from meshslam.categories import Category, keypoint_order
from meshslam.geometry import (
    Camera,
    Floats,
    Ints,
    MaskLoss,
    ObjectModel,
    ObjectState,
    Pose,
    cotangent_weights,
    exp_so3,
    keypoint_loss_gradient,
    keypoint_pixels,
    log_so3,
    pixel_derivatives,
    right_jacobian,
    selection,
)
from meshslam.objects.config import GradientConfig
from meshslam.objects.observations import keypoints_of
from meshslam.objects.reconstruction import Reconstruction, Scene, TrackObservations, find_start
from meshslam.objects.start_search import pose_from_keypoints, triangulate_keypoints
from meshslam.objects.track import choose_views

if TYPE_CHECKING:
    from scipy import sparse


@dataclass(frozen=True, eq=False)
class _GradientObservation:
    """What one frame shows: its mask, and the key points detected in it."""

    world_from_camera: Pose
    theta_c: Floats
    mask: MaskLoss
    pixels: Floats  # (k, 2)
    vis: Floats  # (K, k)


def reconstruct_by_gradient(observed: TrackObservations, scene: Scene) -> Reconstruction:
    """Key points give the mean mesh a pose; then the pose descends, then the vertices.

    Where too few key points were collected for a pose, the search by drawing gives the start.
    """
    config = replace(scene.config, min_keypoint_score=scene.config.gradient.min_keypoint_score)
    points = triangulate_keypoints(observed.track, scene.keypoint_names, scene.category, scene.camera, config)
    start = pose_from_keypoints(points, scene.category)
    if start is None:
        start = find_start(observed, scene)[0][1]
    observations = _observations(observed, scene)
    at_start = scene.model.state_at(start)
    pose = descend_pose(observations, scene.camera, scene.category, start, config.gradient)
    posed = scene.model.state_at(pose)
    shaped = descend_shape(observations, scene.model, scene.category, posed, config.gradient)
    ground = scene.ground_at(pose.translation)
    vertices = scene.model.vertices(shaped)
    losses = [s.mask.gradient(s.world_from_camera.inverse() @ pose, vertices).loss for s in observations]
    return Reconstruction(at_start, posed, shaped, shaped, ground, float(np.mean(losses)))


def _observations(observed: TrackObservations, scene: Scene) -> list[_GradientObservation]:
    config = scene.config.gradient
    track = observed.track.subset(choose_views(observed.track, config.max_views, scene.config))
    names = scene.category.keypoint_names
    order = keypoint_order(scene.keypoint_names, names)
    confident = replace(scene.config, min_keypoint_score=config.min_keypoint_score)
    observations = []
    for detection, pose in zip(track.detections, track.world_from_camera, strict=True):
        numbers, pixels, _ = keypoints_of(detection, order, confident)
        x, y, w, h = (int(v) for v in detection.bbox)
        mask = detection.mask()[y : y + h + 1, x : x + w + 1]
        loss = MaskLoss(scene.camera, len(scene.category.vertices), scene.category.faces, mask, (x, y))
        vis = selection(np.asarray(numbers, int), len(names))
        observations.append(
            _GradientObservation(pose, log_so3(pose.rotation), loss, np.asarray(pixels, float).reshape(-1, 2), vis)
        )
    return observations


def descend_pose(
    observations: Sequence[_GradientObservation],
    camera: Camera,
    category: Category,
    start: Pose,
    config: GradientConfig,
) -> Pose:
    """theta_o and p_o by descent on the views' mean of w_mask L_mask + w_kps L_kps, vertices fixed (Eq. 3)."""
    vertices, keypoints = category.vertices, category.keypoints(category.vertices)
    theta, p = log_so3(start.rotation), start.translation.copy()
    best = (np.inf, start)
    for iteration in range(config.pose_iterations + 1):
        pose = Pose(exp_so3(theta), p)
        loss, slope_theta, slope_p = 0.0, np.zeros(3), np.zeros(3)
        for observation in observations:
            drawn = observation.mask.gradient(observation.world_from_camera.inverse() @ pose, vertices, "kato")
            loss += config.mask_weight * drawn.loss
            slope_p += config.mask_weight * (pose.rotation @ drawn.object[:3])
            slope_theta += config.mask_weight * (right_jacobian(theta).T @ drawn.object[3:])
            more = _keypoint_slopes(observation, camera, theta, p, keypoints)
            loss += config.keypoint_weight * more[0]
            slope_theta += config.keypoint_weight * more[1]
            slope_p += config.keypoint_weight * more[2]
        if loss < best[0]:
            best = (loss, pose)
        scale = _step_scale(iteration, config.pose_iterations) / len(observations)
        theta = theta - config.rotation_step * scale * slope_theta
        p = p - config.position_step * scale * slope_p
    return best[1]


def _keypoint_slopes(
    observation: _GradientObservation, camera: Camera, theta_o: Floats, p_o: Floats, keypoints: Floats
) -> tuple[float, Floats, Floats]:
    """L_kps of one view and its gradients over theta_o and p_o (Propositions 1 and 2)."""
    states = (observation.theta_c, observation.world_from_camera.translation, theta_o, p_o)
    predicted = keypoint_pixels(camera, *states, keypoints)
    if not len(observation.pixels) or not np.isfinite(predicted[observation.vis.any(1)]).all():
        return 0.0, np.zeros(3), np.zeros(3)
    over_pixels = keypoint_loss_gradient(observation.pixels, predicted, observation.vis)
    over = pixel_derivatives(camera, *states, keypoints)
    seen = observation.vis.any(1)
    loss = 0.25 * float((over_pixels**2).sum())  # the gradient is twice the gap
    theta = np.einsum("ni,nij->j", over_pixels[seen], over.theta_o[seen])
    return loss, theta, np.einsum("ni,nij->j", over_pixels[seen], over.p_o[seen])


def descend_shape(
    observations: Sequence[_GradientObservation],
    model: ObjectModel,
    category: Category,
    posed: ObjectState,
    config: GradientConfig,
) -> ObjectState:
    """Vertices by descent on the views' mean of L_mask plus curvature ||L V||^2, pose fixed, symmetry kept."""
    laplacian = mean_curvature(category.vertices, category.faces)
    smoothing = (laplacian.T @ laplacian).tocsr()
    pose, d = posed.world_from_object, posed.d.copy()
    best = (np.inf, d)
    for iteration in range(config.shape_iterations + 1):
        vertices = model.vertices(replace(posed, d=d))
        drawn = [s.mask.gradient(s.world_from_camera.inverse() @ pose, vertices, "kato") for s in observations]
        curvature = smoothing @ vertices
        loss = float(np.mean([g.loss for g in drawn])) + config.curvature_weight * float((vertices * curvature).sum())
        if loss < best[0]:
            best = (loss, d)
        slope = np.mean([g.vertices for g in drawn], axis=0) + 2 * config.curvature_weight * curvature
        d = d - config.vertex_step * _step_scale(iteration, config.shape_iterations) * model.free_form_gradient(slope)
    return replace(posed, d=best[1])


def mean_curvature(vertices: Floats, faces: Ints) -> sparse.csr_array:
    """L (V, V): row i of L V is a vertex minus its neighbours' average by cotangent weights, metres (Sorkine 2006).

    It is the mean curvature normal times an area (Pinkall and Polthier 1993).
    """
    from scipy import sparse  # slow to import

    edges, weights = cotangent_weights(vertices, faces)
    i, j = edges.T
    both = np.concatenate([weights, weights]), (np.concatenate([i, j]), np.concatenate([j, i]))
    adjacency = sparse.coo_array(both, shape=(len(vertices), len(vertices))).tocsr()
    total = np.asarray(adjacency.sum(1)).ravel()
    lone = total == 0
    shares = sparse.diags_array(1.0 / np.where(lone, 1.0, total)) @ adjacency
    laplacian: sparse.csr_array = (sparse.diags_array(np.where(lone, 0.0, 1.0)) - shares).tocsr()
    return laplacian


def _step_scale(iteration: int, iterations: int) -> float:
    """Steps shrink to nothing along half a cosine."""
    return 0.5 * (1.0 + float(np.cos(np.pi * min(1.0, iteration / max(1, iterations)))))
