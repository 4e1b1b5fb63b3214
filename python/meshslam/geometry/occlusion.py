"""Which of several objects hides which in a view."""

from __future__ import annotations

import numpy as np

from meshslam import _core
from meshslam.errors import GeometryError
from meshslam.geometry.arrays import AnyArray, Bools, Floats, Ints
from meshslam.geometry.batched_losses import Cameras, intrinsics_of
from meshslam.geometry.camera import Camera
from meshslam.geometry.native import floats, geometry_errors, ints


def occlusion_order(points_in_camera: AnyArray, faces: Ints, face_counts: tuple[int, ...], camera: Cameras) -> Bools:
    """Whether object j hides object i where both are drawn: (..., n, n), row i, column j.

    `points_in_camera` (..., V, 3) of all objects, metres; the first `face_counts[0]` faces (F, 3) are those of the
    first object, and so on. The nearer one in most of the pixels that both cover hides the other; without a common
    pixel, the one whose points are nearer on average. GeometryError for a value that is not finite, or counts that do
    not add up.
    """
    points, corners, cameras = floats(points_in_camera), ints(faces), intrinsics_of(camera)
    if sum(face_counts) != len(corners):
        raise GeometryError(f"face_counts add up to {sum(face_counts)}, but there are {len(corners)} faces")
    parts = np.split(corners, np.cumsum(face_counts)[:-1])
    intrinsics = np.asarray(cameras.values, np.float64)
    batch = np.broadcast_shapes(points.shape[:-2], intrinsics.shape[:-1])
    points = np.broadcast_to(points, (*batch, *points.shape[-2:]))
    intrinsics = np.broadcast_to(intrinsics, (*batch, 5))
    out = np.zeros((*batch, len(parts), len(parts)), bool)
    for index in np.ndindex(batch):
        out[index] = _in_view(points[index], parts, Camera(cameras.width, cameras.height, *intrinsics[index]))
    return out


def _in_view(points: Floats, parts: list[Ints], camera: Camera) -> Bools:
    image = (0, 0, camera.width, camera.height)
    with geometry_errors():
        nearness = [_core.rasterize(camera, [(points, part)], image)[2] for part in parts]
    mean = [points[np.unique(part), 2].mean() if len(part) else np.inf for part in parts]
    out = np.zeros((len(parts), len(parts)), bool)
    for i in range(len(parts)):
        for j in range(i):
            both = (nearness[i] > 0) & (nearness[j] > 0)
            votes = int(np.sign(nearness[j][both] - nearness[i][both]).sum())
            out[i, j] = votes > 0 or (votes == 0 and mean[j] <= mean[i])
            out[j, i] = not out[i, j]
    return out
