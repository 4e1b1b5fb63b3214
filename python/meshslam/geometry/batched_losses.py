"""Silhouettes by exact areas and the losses over them, of many meshes in many views at once, with their gradients.

Leading dimensions `...` of all arguments broadcast as NumPy's do; faces (F, 3) are those of every mesh of a batch.
Arrays are float64 or float32 and keep their type; the core computes in float64. `camera_from_object` (..., 4, 4) is
read as an affine map: its last row is not read, and a gradient is over each of its entries.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from meshslam import _core
from meshslam.errors import GeometryError
from meshslam.geometry.arrays import AnyArray, Bools, Floats, Ints
from meshslam.geometry.camera import Camera
from meshslam.geometry.native import geometry_errors, ints

Reals = NDArray[np.float64] | NDArray[np.float32]
_Inputs = tuple[Reals, Ints, Reals, Floats]


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """Cameras of a batch whose images have one size."""

    values: Any  # (..., 5): fx, fy, cx, cy, skew, pixels; an array, or a tensor of a framework
    width: int
    height: int


Cameras = Camera | Sequence[Camera] | Intrinsics


@dataclass(frozen=True, eq=False)
class ViewLosses:
    """A loss in each view of a batch, and its gradients, each view for itself."""

    losses: Reals  # (...)
    vertices: Reals | None  # (..., V, 3), 1/m; None if no gradient was asked for
    camera_from_object: Reals | None  # (..., 4, 4), the last row is 0; likewise


def intrinsics_of(camera: Cameras) -> Intrinsics:
    """Intrinsics of one camera, (5,), or of many, (n, 5).

    GeometryError for no camera, or images of several sizes.
    """
    if isinstance(camera, Intrinsics):
        return camera
    cameras = [camera] if isinstance(camera, Camera) else list(camera)
    sizes = {(c.width, c.height) for c in cameras}
    if len(sizes) != 1:
        raise GeometryError(f"the cameras of a batch have images of one size, found {sorted(sizes)}")
    rows = np.array([[c.fx, c.fy, c.cx, c.cy, c.skew] for c in cameras])
    return Intrinsics(rows[0] if isinstance(camera, Camera) else rows, *sizes.pop())


def batched_mask_loss(
    vertices: AnyArray,
    faces: Ints,
    camera_from_object: AnyArray,
    camera: Cameras,
    masks: AnyArray,
    *,
    gradient: Literal["exact", "kato"] = "exact",
    with_gradient: bool = True,
    threads: int = 0,
) -> ViewLosses:
    """L_mask = -I/U of meshes (..., V, 3) against masks (..., h, w), and its gradients (paper, Eq. 2, Proposition 1).

    `exact`: I and U are areas, and the gradient is theirs. `kato`: I and U count pixels, and the gradient is the
    paper's approximation (Kato, Ushiku and Harada 2018). Masks are bytes (0, or in the mask) or shares from 0 to 1. The
    loss is -1 where nothing is drawn and nothing was observed. On `threads` threads (0: all), whose number changes no
    bit. GeometryError for a shape that does not fit, a value that is not finite, or a face that names no vertex.
    """
    inputs, size = _inputs(vertices, faces, camera_from_object, camera)
    seen = _mask(masks)
    if seen.shape[-2:] != size[::-1]:
        raise GeometryError(f"masks have shape {seen.shape}, expected (..., {size[1]}, {size[0]}), the camera's image")
    with geometry_errors():
        return ViewLosses(*_core.mask_iou_losses(inputs, seen, gradient, with_gradient, threads))


def batched_silhouettes(
    vertices: AnyArray, faces: Ints, camera_from_object: AnyArray, camera: Cameras, *, threads: int = 0
) -> Reals:
    """How much of each pixel a mesh covers, (..., h, w), 0 to 1: the exact area, up to rounding.

    A mesh covers what any of its faces covers, whatever their winding; faces are cut at 0.1 m. GeometryError as for
    `batched_mask_loss`.
    """
    inputs, (width, height) = _inputs(vertices, faces, camera_from_object, camera)
    leading = [inputs[0].shape[:-2], inputs[2].shape[:-2], inputs[3].shape[:-1]]
    with geometry_errors():
        batch = _core.broadcast_shape(leading)
        try:
            pictures: Reals = np.zeros((*batch, height, width), inputs[0].dtype)
        except MemoryError as error:
            raise GeometryError(f"no memory for pictures of shape {(*batch, height, width)}") from error
        _core.silhouettes(inputs, pictures, threads)
    return pictures


def batched_silhouette_gradients(
    vertices: AnyArray,
    faces: Ints,
    camera_from_object: AnyArray,
    camera: Cameras,
    slopes: AnyArray,
    *,
    threads: int = 0,
) -> tuple[Reals, Reals]:
    """Gradients over vertices (..., V, 3) and poses (..., 4, 4) of any loss, from its `slopes` over the silhouettes.

    Slopes (..., h, w); each view for itself: `summed_over_views` adds up what views share. GeometryError as for
    `batched_mask_loss`.
    """
    inputs, size = _inputs(vertices, faces, camera_from_object, camera)
    slope = reals(slopes)
    if slope.shape[-2:] != size[::-1]:
        raise GeometryError(f"slopes have shape {slope.shape}, expected (..., {size[1]}, {size[0]})")
    with geometry_errors():
        found = _core.silhouette_gradients(inputs, slope, threads)
    return found[0], found[1]


def batched_keypoint_loss(
    vertices: AnyArray,
    association: AnyArray,
    camera_from_object: AnyArray,
    camera: Cameras,
    observed: AnyArray,
    visible: Bools,
    *,
    threads: int = 0,
) -> ViewLosses:
    """L_kps = sum of |y_hat - y|^2 over the visible key points, squared pixels, and its gradients (paper, Eq. 2 and 8).

    `association` A (V, K): key point k lies at A[:, k]^T V. `observed` y (..., K, 2), pixels, `visible` (..., K); what
    is not visible may be NaN. GeometryError for a visible key point nearer than 0.1 m, and as for `batched_mask_loss`.
    """
    inputs, _ = _inputs(vertices, np.zeros((0, 3), np.int64), camera_from_object, camera)
    weights = np.ascontiguousarray(reals(association), np.float64)
    with geometry_errors():
        return ViewLosses(*_core.keypoint_losses(inputs, weights, reals(observed), np.asarray(visible, bool), threads))


def summed_over_views(values: AnyArray, leading: tuple[int, ...], weights: AnyArray | None = None) -> Reals:
    """Sum of values (..., r, c) over the views that share an input of leading shape `leading`, in the views' order.

    Each view's values are multiplied by its weight first, (...), if there are weights. GeometryError for shapes that do
    not go together.
    """
    with geometry_errors():
        return _core.weighted_sums(reals(values), None if weights is None else reals(weights), list(leading))


def reals(values: AnyArray) -> Reals:
    """float64 or float32 as it is, in any strides; integers as float64. GeometryError for any other type."""
    array = np.asarray(values)
    if array.dtype in (np.float64, np.float32):
        return array
    if array.dtype.kind not in "iub":
        raise GeometryError(f"values must be float64 or float32, found {array.dtype}")
    return array.astype(np.float64)


def _inputs(
    vertices: AnyArray, faces: Ints, camera_from_object: AnyArray, camera: Cameras
) -> tuple[_Inputs, tuple[int, int]]:
    corners = np.asarray(faces)
    if corners.dtype.kind not in "iu":
        raise GeometryError(f"faces are indices of vertices, found {corners.dtype}")
    cameras = intrinsics_of(camera)
    intrinsics = np.asarray(cameras.values, np.float64)
    return (reals(vertices), ints(corners), reals(camera_from_object), intrinsics), (cameras.width, cameras.height)


def _mask(values: AnyArray) -> AnyArray:
    """Bytes or floats; booleans are bytes already."""
    array = np.asarray(values)
    if array.dtype == bool:
        return array.view(np.uint8)
    if array.dtype == np.uint8 or array.dtype in (np.float64, np.float32):
        return array
    raise GeometryError(f"masks must be bool, uint8, float32 or float64, found {array.dtype}")
