"""An object that is done: whether it belongs into the map, with its uncertainty and its figures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshslam.mapping.common_shape import shape_evidence
from meshslam.mapping.config import MappingConfig
from meshslam.mapping.judgement import motion_of, why_unfit
from meshslam.mapping.left_out import LeftOut
from meshslam.mapping.work import Work, mean_iou
from meshslam.maps import MapObject
from meshslam.moving import ShapeEvidence
from meshslam.objects import Scene, TrackObservations, centred, fit_modes, reversed_probability, uncertainty


@dataclass(frozen=True, eq=False)
class Finished:
    """What the last sweep leaves of an object: all but its views."""

    work: Work
    unfit: LeftOut | None = None  # why it is no object of the map
    object: MapObject | None = None
    ious: tuple[float, ...] = ()  # as `mean_ious` names them
    reversed_probability: float | None = None  # that it faces the other way; None where no detection tells
    shape: ShapeEvidence | None = None
    motion_gain: float = 0.0  # by which the cost falls with a velocity


def finished(work: Work, scene: Scene, config: MappingConfig) -> Finished:
    """Judge an object whose views are there, and take from them what the map holds."""
    moved = motion_of(work, scene)
    unfit = why_unfit(work, scene, config, moved=moved)
    if unfit is not None:
        return Finished(work.without_views(), unfit)
    doubt = reversed_probability(work.observed.track, work.found.state.world_from_object)
    return Finished(
        work.without_views(),
        None,
        _map_object(work, scene),
        _ious(work, scene),
        reversed_probability=doubt,
        shape=shape_evidence(work, scene),
        motion_gain=moved[1],
    )


def _map_object(work: Work, scene: Scene) -> MapObject:
    track, mesh = work.observed.track, centred(scene.model, work.found.state)
    covariance, sigma, seen = uncertainty(work.observed, scene, work.found)
    keypoints = scene.category.keypoints(mesh.vertices)
    frames = [d.frame for d in track.detections]
    return MapObject(
        id=track.id,
        category=scene.category.name,
        world_from_object=mesh.world_from_object,
        vertices=mesh.vertices,
        faces=scene.model.faces,
        views=len(track.detections),
        first_frame=min(frames),
        last_frame=max(frames),
        mask_iou=mean_iou(work, scene),
        keypoints=dict(zip(scene.category.keypoint_names, keypoints, strict=True)),
        pose_covariance=covariance,
        vertex_sigma_m=sigma,
        vertex_observed=seen,
    )


def mean_ious(done: list[Finished]) -> dict[str, float]:
    """Mask IoU after each step, mean over objects of the mean over their views."""
    if not done:
        return {}
    names = ("mask_iou_single_frame", "mask_iou_category_model", "mask_iou_pose", "mask_iou_shape")
    columns = zip(*(one.ious for one in done), strict=True)
    return {name: float(np.mean(column)) for name, column in zip(names, columns, strict=True)}


def _ious(work: Work, scene: Scene) -> tuple[float, ...]:
    """Mask IoU from one frame alone, and after each step, mean over the views."""
    stages = (work.found.start, work.found.posed, work.found.state)
    return _single_frame_iou(work, scene), *(mean_iou(work, scene, state) for state in stages)


def _single_frame_iou(work: Work, scene: Scene) -> float:
    """Pose and modes from the one frame that shows the object largest, scored on it."""
    sizes = [d.bbox[2] * d.bbox[3] for d in work.observed.track.detections]
    best = [int(np.argmax(sizes))]
    track, views = work.observed.track.subset(best), [work.observed.views[i] for i in best]
    alone = TrackObservations(track, views, track, views)
    [found] = fit_modes(alone, scene, [work.found.start.world_from_object])
    return mean_iou(replace(work, observed=alone), scene, found.state)
