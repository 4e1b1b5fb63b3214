"""The road's texture in two images, compared over the length of the displacement between them; the core computes it."""

from __future__ import annotations

import numpy as np

from meshslam import _core
from meshslam.geometry.arrays import Bytes, Floats
from meshslam.geometry.camera import Camera
from meshslam.geometry.native import floats, geometry_errors
from meshslam.geometry.pose import Pose


class RoadTexture:
    """Points of a plane ahead of the second of two cameras, with their grey values in its image.

    `len` is how many points there are.
    """

    def __init__(
        self,
        camera: Camera,
        images: tuple[Bytes, Bytes],
        free: Bytes,
        first_from_second: Pose,
        *,
        up: Floats,
        height_m: float,
        depths_m: tuple[float, float],
        aside_m: float,
        step_px: int,
    ) -> None:
        """`images` (h, w) are grey, of the first and the second camera; `free` (h, w) is not 0 where the plane is seen.

        The plane lies `height_m` below the second camera, whose frame `up` (3,) is given in, of length 1. Its points
        are taken every `step_px` pixels, at depths between the two `depths_m`, `aside_m` to the left and right at most.
        GeometryError for a picture of another size than the camera's, no displacement, a step below 1, and for numbers
        that are not finite.
        """
        grey = np.ascontiguousarray(images[0], np.uint8), np.ascontiguousarray(images[1], np.uint8)
        with geometry_errors():
            self._native = _core.RoadTexture(
                camera,
                grey,
                np.ascontiguousarray(free, np.uint8),
                first_from_second.matrix,
                floats(up),
                height_m,
                depths_m,
                aside_m,
                step_px,
            )

    def __len__(self) -> int:
        return len(self._native)

    def correlations(self, displacements_m: Floats) -> Floats:
        """Normalized correlation (n,) of the grey values in both images, for lengths (n,) of the displacement, metres.

        -1 where fewer than half of the points lie on the first image. Its grey values are bilinear, rounded to whole
        numbers.
        """
        return self._native.correlations(floats(displacements_m))
