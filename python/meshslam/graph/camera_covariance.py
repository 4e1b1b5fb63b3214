"""From the joint covariance of a graph's variables to that of a camera's pose.

A camera's pose follows from the IMU's pose X and velocity V, the mounting's rotation E and the clocks' offset T; its
covariance is that of a right perturbation, (translation, rotation).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.graph.marginals import Group
from meshslam.graph.object_factor import CameraKeys, CameraPlace
from meshslam.graph.window import Window

_STEP = 1e-5  # m, rad, of a difference quotient


def camera_covariance(place: CameraPlace, joint: Floats) -> Floats:
    """Covariance (6, 6) of world_from_camera from that (13, 13) of X, V, E and T."""
    by_all = place.by_variables
    return _symmetric(by_all @ joint @ by_all.T)


def path_covariances(
    window: Window,
    places: Sequence[CameraPlace],
    keys: Sequence[CameraKeys],
    world_from_first_camera: Callable[[Pose], Pose] | None = None,
) -> Floats:
    """Covariances (n, 6, 6) of a path's cameras, by one elimination for all of them.

    `places` and `keys` are those of each frame. Where the path is moved by a transform that its own first pose C_0
    decides, W = `world_from_first_camera`(C_0), the covariance is that of W C_i: the share of the first pose's
    uncertainty that W takes out is out, that of all others is relative to it.
    """
    by_first = world_by_first(places[0].pose, world_from_first_camera)
    is_moved = bool(np.abs(by_first).max() > 0)
    first = keys[0]
    groups: list[Group] = [k if not is_moved or k == first else (*k, *first[:2]) for k in keys]
    joint = window.path_covariances(groups, first if is_moved else first[2:])
    if not is_moved:
        return np.array([camera_covariance(place, found) for place, found in zip(places, joint, strict=True)])
    by_first = by_first @ places[0].by_variables
    out = []
    for place, group, found in zip(places, groups, joint, strict=True):
        # W C_i moves with C_i, and by Ad(C_i^-1 W^-1) with W
        by_all = np.zeros((6, len(found)))
        by_all[:, :13] = place.by_variables
        moved = place.pose.inverse().adjoint() @ by_first
        own = slice(0, 9) if len(group) == 4 else slice(13, 22)
        by_all[:, own] += moved[:, :9]
        by_all[:, 9:13] += moved[:, 9:]
        out.append(_symmetric(by_all @ found @ by_all.T))
    return np.array(out)


def world_by_first(first: Pose, world_from_first_camera: Callable[[Pose], Pose] | None) -> Floats:
    """Derivative (6, 6) of W over C_0: W(C_0 exp(x)) = W exp(this @ x), by differences; 0 where W is constant."""
    if world_from_first_camera is None:
        return np.zeros((6, 6))
    columns = []
    for step in _STEP * np.eye(6):
        ahead, behind = (world_from_first_camera(first.retract(sign * step)) for sign in (1.0, -1.0))
        columns.append(behind.local(ahead) / (2 * _STEP))
    return np.array(columns).T


def _symmetric(matrix: Floats) -> Floats:
    return 0.5 * (matrix + matrix.T)
