"""Measures of meshes and of masks."""

from __future__ import annotations

import numpy as np

from meshslam import _core
from meshslam.geometry.arrays import Bytes, Floats, Ints
from meshslam.geometry.native import floats, geometry_errors, ints

VOXEL_STEP_M = 0.05


def voxel_iou(
    vertices_a: Floats, faces_a: Ints, vertices_b: Floats, faces_b: Ints, step_m: float = VOXEL_STEP_M
) -> float:
    """Intersection over union of two closed meshes' volumes in one frame, on a grid of `step_m`, from 0 to 1.

    Vertices (n, 3) in metres, faces (m, 3). GeometryError for a value that is not finite, a face that names no vertex,
    a grid that is too large, or a step that is not positive.
    """
    with geometry_errors():
        return _core.voxel_iou(floats(vertices_a), ints(faces_a), floats(vertices_b), ints(faces_b), step_m)


def mask_iou(a: Bytes, b: Bytes) -> float:
    """Intersection over union, from 0 to 1, of two masks (h, w) of one size, set above 0; 1 if both are empty.

    >>> a, b = np.array([[1, 1, 0]], np.uint8), np.array([[1, 0, 0]], np.uint8)
    >>> float(mask_iou(a, b))
    0.5
    """
    both, either = np.count_nonzero((a > 0) & (b > 0)), np.count_nonzero((a > 0) | (b > 0))
    return both / either if either else 1.0


def cotangent_weights(vertices: Floats, faces: Ints) -> tuple[Ints, Floats]:
    """Edges (e, 2) of a mesh and their cotangent weights (e,), held above 1e-3 (Pinkall and Polthier 1993).

    Vertices (n, 3) in metres, faces (m, 3). GeometryError for a value that is not finite, or a face that names no
    vertex.
    """
    with geometry_errors():
        return _core.cotangent_weights(floats(vertices), ints(faces))
