"""Covariances of a smoothed run's objects: how much of them is the path's, how much would be left if it were known.

For an object O and the path's variables C, by the law of total covariance

    cov(O) = cov(O | C) + G cov(C) G^T,

G being how the estimate of O moves with the path. The second part is what a fit along the path, taken as exact, lacks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from gtsam.symbol_shorthand import O, Z

from meshslam.geometry import Floats, Pose
from meshslam.graph.camera_covariance import world_by_first
from meshslam.graph.object_factor import CameraKeys, CameraPlace
from meshslam.graph.window import Window
from meshslam.motion import from_pose3, to_gtsam_columns, to_gtsam_covariance


@dataclass(frozen=True, eq=False)
class ObjectCovariance:
    """Covariances (6, 6) of a landmark's world_from_object: right perturbations, (translation, rotation), m and rad."""

    world_from_object: Pose
    whole: Floats
    by_path: Floats  # its part that the path's uncertainty makes, the size that all objects share included

    def path_part(self, world_from_mesh: Pose) -> Floats:
        """`by_path` as a perturbation of another pose that moves rigidly with this one."""
        return moved_covariance(self.by_path, self.world_from_object, world_from_mesh)


def moved_covariance(covariance: Floats, of: Pose, to: Pose) -> Floats:
    """Covariance (6, 6) of a right perturbation of pose `of` as one of `to`, which moves rigidly with it."""
    adjoint = (to.inverse() @ of).adjoint()
    moved: Floats = adjoint @ covariance @ adjoint.T
    return moved


def object_covariances(
    window: Window,
    numbers: Sequence[int],
    first: tuple[CameraPlace, CameraKeys],
    world_from_first_camera: Callable[[Pose], Pose] | None = None,
) -> dict[int, ObjectCovariance]:
    """Covariances of landmarks in a graph that holds a whole run, by one elimination for all of them.

    `first` is the first camera with its variables. Where it lays the world, W = `world_from_first_camera`(C_0), poses
    and covariances are those of W O, as `path_covariances` has those of W C.
    """
    if not numbers:
        return {}
    place, keys = first
    world = Pose.identity() if world_from_first_camera is None else world_from_first_camera(place.pose)
    by_first = world_by_first(place.pose, world_from_first_camera)
    is_moved = bool(np.abs(by_first).max() > 0)
    groups = [(O(n), *keys) if is_moved else (O(n),) for n in numbers]
    joints = window.path_covariances(groups, keys if is_moved else keys[2:])
    found = {}
    for number, joint in zip(numbers, joints, strict=True):
        pose = from_pose3(window.values.atPose3(O(number)))
        by_all = to_gtsam_columns(np.eye(6))
        if is_moved:
            by_all = np.hstack([by_all, pose.inverse().adjoint() @ by_first @ place.by_variables])
        whole = _symmetric(by_all @ joint @ by_all.T)
        own = _given_the_rest(window, number)
        found[number] = ObjectCovariance(world @ pose, whole, _positive(whole - own))
    return found


def _given_the_rest(window: Window, number: int) -> Floats:
    """Covariance (6, 6) of an object's pose where all variables but its own modes are known."""
    own, start = (O(number), Z(number)), {}
    width = 0
    for key in own:
        start[key], width = width, width + window.values.extract([key]).dim()
    information = np.zeros((width, width))
    for entry in window.entries:
        if entry.keys.isdisjoint(own):
            continue
        linear = entry.factor.linearize(window.values)
        hessian, at, columns = np.asarray(linear.information()), 0, []
        for key in linear.keys():  # noqa: SIM118 # no mapping
            size = window.values.extract([key]).dim()
            columns += [(at + i, start[key] + i) for i in range(size)] if key in start else []
            at += size
        inside, outside = np.array(columns).T
        information[np.ix_(outside, outside)] += hessian[np.ix_(inside, inside)]
    covariance: Floats = np.asarray(np.linalg.inv(information), float)[:6, :6]
    return to_gtsam_covariance(covariance)


def _positive(matrix: Floats) -> Floats:
    """The nearest matrix that is no less than zero."""
    values, axes = np.linalg.eigh(_symmetric(matrix))
    nearest: Floats = (axes * np.maximum(values, 0.0)) @ axes.T
    return nearest


def _symmetric(matrix: Floats) -> Floats:
    return 0.5 * (matrix + matrix.T)
