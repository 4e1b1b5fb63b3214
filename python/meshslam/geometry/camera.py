"""The pinhole camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry.arrays import Floats


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with skew: x right, y down, z forward; pixel (0, 0) is the centre of the top-left pixel.

    All values are in pixels. GeometryError for an image without pixels, a focal length that is not positive, or a value
    that is not finite.

    >>> camera = Camera(640, 480, fx=500.0, fy=500.0, cx=320.0, cy=240.0)
    >>> camera.project(np.array([0.2, -0.1, 2.0]))
    array([370., 215.])
    """

    width: int
    height: int
    fx: float  # focal lengths
    fy: float
    cx: float  # principal point
    cy: float
    skew: float = 0.0  # the entry K[0, 1]

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise GeometryError(f"a camera's image has at least one pixel, found {self.width}x{self.height}")
        if not np.isfinite([self.fx, self.fy, self.cx, self.cy, self.skew]).all() or self.fx <= 0 or self.fy <= 0:
            raise GeometryError(f"a camera's focal lengths are positive and finite, found fx={self.fx}, fy={self.fy}")

    @property
    def matrix(self) -> Floats:
        """The (3, 3) intrinsic matrix K."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def project(self, points_in_camera: Floats) -> Floats:
        """Project points (..., 3), metres, to pixels (..., 2); points on or behind the image plane give NaN."""
        x, y, z = np.moveaxis(np.asarray(points_in_camera, float), -1, 0)
        depth = np.where(z > 0, z, np.nan)
        u = (self.fx * x + self.skew * y) / depth + self.cx
        return np.stack([u, self.fy * y / depth + self.cy], axis=-1)

    def projection_jacobian(self, points_in_camera: Floats) -> Floats:
        """Derivatives (..., 2, 3) of the pixels of points (..., 3) over the points, pixels a metre.

        NaN on or behind the image plane, where no pixel is.
        """
        x, y, z = np.moveaxis(np.asarray(points_in_camera, float), -1, 0)
        depth = np.where(z > 0, z, np.nan)
        out = np.zeros((*depth.shape, 2, 3))
        out[..., 0, 0], out[..., 0, 1] = self.fx / depth, self.skew / depth
        out[..., 0, 2] = -(self.fx * x + self.skew * y) / depth**2
        out[..., 1, 1], out[..., 1, 2] = self.fy / depth, -self.fy * y / depth**2
        out[np.isnan(depth)] = np.nan
        return out

    def rays(self, pixels: Floats) -> Floats:
        """Directions (..., 3) in the camera with z = 1 through pixels (..., 2)."""
        y = (pixels[..., 1] - self.cy) / self.fy
        x = (pixels[..., 0] - self.cx - self.skew * y) / self.fx
        return np.stack([x, y, np.ones_like(x)], axis=-1)
