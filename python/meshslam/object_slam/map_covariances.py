"""Covariances of a map's objects that were fitted along a smoothed path: the path's uncertainty is added."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from meshslam.geometry import Floats
from meshslam.graph import ObjectCovariance, moved_covariance
from meshslam.maps import Map, MapObject, TrajectoryEstimate


def with_path_covariances(scene: Map, of_graph: Mapping[int, ObjectCovariance], estimate: TrajectoryEstimate) -> Map:
    """The map, its covariances being those along a path that is taken as exact, with the path's part added.

    `of_graph` are those of the graph's objects, by id. An object that the graph never took in moves with the camera
    that came nearest to it.
    """
    index = {frame: i for i, frame in enumerate(estimate.frame_ids)}
    objects = tuple(_with_path(thing, of_graph.get(thing.id), estimate, index) for thing in scene.objects)
    return replace(scene, objects=objects)


def _with_path(
    thing: MapObject, of_graph: ObjectCovariance | None, estimate: TrajectoryEstimate, index: Mapping[int, int]
) -> MapObject:
    if thing.pose_covariance is None:
        return thing
    pose = thing.world_from_object
    part = _of_nearest_camera(thing, estimate, index) if of_graph is None else of_graph.path_part(pose)
    return replace(thing, pose_covariance=thing.pose_covariance + 0.5 * (part + part.T))


def _of_nearest_camera(thing: MapObject, estimate: TrajectoryEstimate, index: Mapping[int, int]) -> Floats:
    poses, at = estimate.trajectory.world_from_camera, thing.world_from_object
    first, last = (0, len(poses) - 1)
    if thing.first_frame is not None and thing.last_frame is not None:
        first, last = index[thing.first_frame], index[thing.last_frame]
    away = [np.linalg.norm(pose.translation - at.translation) for pose in poses[first : last + 1]]
    nearest = first + int(np.argmin(away))
    return moved_covariance(estimate.covariances[nearest], poses[nearest], at)
