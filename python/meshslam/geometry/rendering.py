"""Drawing meshes: what is nearest in each pixel, and the outline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshslam import _core
from meshslam.geometry.arrays import Bytes, Floats, Ints
from meshslam.geometry.camera import Camera
from meshslam.geometry.native import floats, geometry_errors, ints
from meshslam.geometry.pose import Pose


@dataclass(frozen=True, eq=False)
class Rendering:
    """What is nearest in each pixel of an image (or of a rectangle of it)."""

    object_index: NDArray[np.int32]  # (h, w), which of the meshes; -1 where there is none
    face_index: NDArray[np.int32]  # (h, w), which of its faces; -1 where there is none
    inverse_depth: Floats  # (h, w), 1/m; 0 where there is none

    @property
    def mask(self) -> Bytes:
        """(h, w), 1 where any mesh is drawn."""
        return (self.object_index >= 0).astype(np.uint8)

    @property
    def depth_m(self) -> Floats:
        """(h, w), metres along the camera's axis; infinity where there is none."""
        with np.errstate(divide="ignore"):
            depth: Floats = 1.0 / self.inverse_depth
        return depth


def render(
    camera: Camera,
    meshes: Sequence[tuple[Pose, Floats, Ints]],
    rect: tuple[int, int, int, int] | None = None,
) -> Rendering:
    """Draw meshes in one view, nearest in front (paper, Eq. 9).

    Each mesh is (camera_from_object, vertices (n, 3) in metres, faces (m, 3)); `rect` is (x0, y0, width, height), by
    default the whole image. A pixel is drawn where its centre lies in a face; on an edge the top-left rule decides.
    Faces are cut at 0.1 m. GeometryError for NaN, or a face that names no vertex.
    """
    placed = [(floats(pose.transform(floats(vertices))), ints(faces)) for pose, vertices, faces in meshes]
    with geometry_errors():
        found = _core.rasterize(camera, placed, rect or (0, 0, camera.width, camera.height))
    return Rendering(*found)


def coverage(
    camera: Camera,
    camera_from_object: Pose,
    vertices: Floats,
    faces: Ints,
    rect: tuple[int, int, int, int] | None = None,
    samples: int = 4,
) -> Floats:
    """Soft coverage (height, width): how much of each pixel a mesh covers, 0 to 1, by `samples` x `samples` points.

    `rect` is (x0, y0, width, height), by default the whole image. Samples follow the rules of `render`, so that the
    coverages of faces that share an edge add up. GeometryError for NaN, or a face that names no vertex.
    """
    with geometry_errors():
        return _core.coverage(
            camera,
            floats(camera_from_object.transform(floats(vertices))),
            ints(faces),
            rect or (0, 0, camera.width, camera.height),
            samples,
        )


@dataclass(frozen=True, eq=False)
class Outline:
    """Samples of a mesh's outline in a view."""

    pixels: Floats  # (n, 2)
    normals: Floats  # (n, 2), away from the mesh
    vertices: Ints  # (n, 2), the ends of the sample's edge
    weights: Floats  # (n,), the point is (1 - w) a + w b
    lengths_px: Floats  # (n,), the length of outline that the sample stands for


def outline(
    camera: Camera,
    camera_from_object: Pose,
    vertices: Floats,
    faces: Ints,
    step_px: float = 1.5,
) -> Outline:
    """Sample the outline of a mesh, `step_px` apart or less, where no other part of the mesh covers its outer side.

    Vertices (n, 3) in metres, faces (m, 3). GeometryError for a value that is not finite, a face that names no
    vertex, or a step that is not positive.
    """
    with geometry_errors():
        rows = _core.outline(
            camera,
            floats(camera_from_object.transform(floats(vertices))),
            ints(faces),
            (0, 0, camera.width, camera.height),
            step_px,
        )
    return Outline(rows[:, :2], rows[:, 2:4], rows[:, 4:6].astype(np.int64), rows[:, 6], rows[:, 7])
