"""Conventions that files of poses come in, as world_from_camera with z up, camera axes x right, y down, z forward."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from meshslam.geometry import Floats, Pose

Convention = Literal["camera", "quaternion-first", "camera-from-world", "first-camera-world", "body"]
CONVENTIONS: tuple[Convention, ...] = get_args(Convention)
# (x, y, z)_world = (z, -x, -y)_camera: the camera's axes renamed, so that z is up; also forward, left, up of a body
WORLD_FROM_FIRST_CAMERA = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))


def in_convention(poses: tuple[Pose, ...], convention: Convention) -> tuple[Pose, ...]:
    """world_from_camera of poses that were read as such, but are of another convention.

    `quaternion-first`: w, x, y, z in the file. `camera-from-world`: the inverse. `first-camera-world`: the world is the
    first camera, whose axes are renamed so that z is up. `body`: poses of a body (x forward, y left, z up) at the
    camera's place.
    """
    if convention == "quaternion-first":
        return tuple(Pose(_reordered(pose.rotation), pose.translation) for pose in poses)
    if convention == "camera-from-world":
        return tuple(pose.inverse() for pose in poses)
    if convention == "first-camera-world":
        return tuple(WORLD_FROM_FIRST_CAMERA @ pose for pose in poses)
    if convention == "body":
        return tuple(pose @ WORLD_FROM_FIRST_CAMERA for pose in poses)
    return poses


def _reordered(rotation: Floats) -> Floats:
    """The rotation that w, x, y, z make which were read as x, y, z, w."""
    w, x, y, z = Pose(rotation, np.zeros(3)).to_quaternion(order="xyzw")
    return Pose.from_quaternion(np.array([x, y, z, w]), np.zeros(3), order="xyzw").rotation
