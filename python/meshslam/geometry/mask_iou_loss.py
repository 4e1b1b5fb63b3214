"""L_mask of a drawn mesh and its gradients (paper, Eq. 2 and Propositions 1 and 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshslam import _core
from meshslam.geometry.arrays import Bytes, Floats, Ints
from meshslam.geometry.camera import Camera
from meshslam.geometry.native import floats, geometry_errors, ints, raise_as_geometry_error
from meshslam.geometry.pose import Pose


@dataclass(frozen=True, eq=False)
class MaskGradient:
    """The loss -I/U, from -1 to 0, and its gradients; areas I and U in pixels, tangents (translation, rotation)."""

    loss: float
    intersection: float
    union: float
    vertices: Floats  # (V, 3), over the vertices in the object's frame, 1/m
    object: Floats  # (6,), over a right perturbation of world_from_object
    camera: Floats  # (6,), over a right perturbation of world_from_camera


class MaskLoss:
    """L_mask of one mesh topology against one observed mask in one camera (paper, Eq. 2)."""

    def __init__(
        self, camera: Camera, vertex_count: int, faces: Ints, mask: Bytes, origin: tuple[int, int] = (0, 0)
    ) -> None:
        """Take faces (F, 3) and a mask (h, w) whose first pixel is `origin` (x, y); beyond it nothing is observed.

        GeometryError for a wrong shape, or a face that names no vertex.
        """
        with geometry_errors():
            self._native = _core.MaskLoss(
                camera, vertex_count, ints(faces), np.ascontiguousarray(mask, np.uint8), origin
            )

    def gradient(
        self, camera_from_object: Pose, vertices: Floats, method: Literal["exact", "kato"] = "exact"
    ) -> MaskGradient:
        """Loss and gradient at a pose with vertices (V, 3), metres, in the object's frame.

        `exact` integrates over the mask's outline; `kato` is the paper's approximation (Kato, Ushiku and Harada 2018).
        GeometryError for a wrong shape, or a value that is not finite.
        """
        pose = camera_from_object
        try:
            found = self._native.gradient(
                floats(pose.rotation), floats(pose.translation), floats(vertices), method == "kato"
            )
        except (ValueError, IndexError, TypeError, OverflowError) as error:  # a context manager costs a tenth of a call
            raise_as_geometry_error(error)
        return MaskGradient(*found)

    def draw(self, camera_from_object: Pose, vertices: Floats) -> Bytes:
        """R_mask: the mask (h, w) of vertices (V, 3), metres, on the whole image, 0 or 1 (paper, Eq. 9).

        GeometryError for a wrong shape, or a value that is not finite.
        """
        with geometry_errors():
            pose = camera_from_object
            return self._native.draw(floats(pose.rotation), floats(pose.translation), floats(vertices))

    def seconds(self, camera_from_object: Pose, vertices: Floats, runs: int) -> list[float]:
        """Seconds of each of `runs` exact evaluations: drawing, loss, chain rule; not what crosses over."""
        with geometry_errors():
            pose = camera_from_object
            return self._native.time(floats(pose.rotation), floats(pose.translation), floats(vertices), runs)


def mask_gradients(
    losses: Sequence[MaskLoss], camera_from_object: Sequence[Pose], vertices: Floats, threads: int = 0
) -> list[MaskGradient]:
    """Exact gradients of one mesh, vertices (V, 3) in metres, in many views, on `threads` threads at once (0: all).

    One loss and one pose a view. GeometryError for a wrong shape, or a value that is not finite.
    """
    with geometry_errors():
        poses = [(floats(pose.rotation), floats(pose.translation)) for pose in camera_from_object]
        found = _core.mask_gradients([loss._native for loss in losses], poses, floats(vertices), threads)
    return [MaskGradient(*row) for row in found]


def kato_pixel_gradient(vertex_pixels: Floats, faces: Ints, face_index: Ints, slope: Floats) -> Floats:
    """Kato's gradient (V, 2) over vertex pixels (V, 2).

    `face_index` (h, w) is the face that each pixel shows, -1 for none; `slope` (h, w) is the loss's over its colour.
    The gradient is in loss a pixel (Kato, Ushiku and Harada 2018). GeometryError for a wrong shape, an index that does
    not exist, or a value that is not finite.
    """
    with geometry_errors():
        return _core.kato_pixel_gradient(
            floats(vertex_pixels), ints(faces), np.ascontiguousarray(face_index, np.int32), floats(slope)
        )
