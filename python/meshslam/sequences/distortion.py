"""Lens distortion, taken out once at the door: everything behind a Sequence is pinhole."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import Bytes, Camera, Floats
from meshslam.sequences.images import MAX_PIXELS


@dataclass(frozen=True, eq=False)
class Distortion:
    """Radial-tangential distortion (Brown 1971, OpenCV's order k1, k2, p1, p2[, k3]) from a raw to a pinhole camera."""

    raw_camera: Camera
    camera: Camera  # the undistorted one
    coefficients: Floats  # (4,) or (5,)
    _maps: tuple[Floats, ...] = field(init=False, repr=False, default=())

    def __post_init__(self) -> None:
        size = max(camera.width * camera.height for camera in (self.raw_camera, self.camera))
        if size > MAX_PIXELS:
            raise GeometryError(f"an image of {size} pixels: more than {MAX_PIXELS} are not undistorted")
        pixels = _pixel_grid(self.camera)
        if not self._invertible():
            raise GeometryError(
                "the distortion folds over within the image: check the coefficients' order k1, k2, p1, p2, k3"
            )
        object.__setattr__(self, "_maps", tuple(np.moveaxis(self.distort(pixels), -1, 0).astype(np.float32)))

    def distort(self, pixels: Floats) -> Floats:
        """Take pixels (..., 2) of the undistorted camera to the raw camera."""
        return _pixels(self.raw_camera, _bend(self.camera.rays(pixels)[..., :2], self.coefficients))

    def undistort(self, pixels: Floats) -> Floats:
        """Take pixels (..., 2) of the raw camera to the undistorted one, by Newton's method."""
        target = self.raw_camera.rays(pixels)[..., :2]
        straight = target.copy()
        for _ in range(20):
            step = np.linalg.solve(
                _slope(straight, self.coefficients), (target - _bend(straight, self.coefficients))[..., None]
            )
            straight = straight + step[..., 0]
        return _pixels(self.camera, straight)

    def undistort_image(self, image: Bytes) -> Bytes:
        """Resample a raw image (h, w[, 3]), bilinear."""
        return np.asarray(cv2.remap(image, self._maps[0], self._maps[1], cv2.INTER_LINEAR), np.uint8)

    def undistort_mask(self, mask: Bytes) -> Bytes:
        """Resample a raw mask (h, w), nearest pixel."""
        return np.asarray(cv2.remap(mask, self._maps[0], self._maps[1], cv2.INTER_NEAREST), np.uint8)

    def _invertible(self) -> bool:
        raw = _pixel_grid(self.raw_camera, 33)
        with np.errstate(all="ignore"):
            try:
                back = self.undistort(raw)
                error = np.abs(self.distort(back) - raw).max()
            except np.linalg.LinAlgError:
                return False
            slopes = np.linalg.det(_slope(self.camera.rays(back)[..., :2], self.coefficients))
        return bool(np.isfinite(error) and error < 0.01 and (slopes > 0).all())


def _pixel_grid(camera: Camera, steps: int = 0) -> Floats:
    u = np.linspace(0, camera.width - 1, steps or camera.width)
    v = np.linspace(0, camera.height - 1, steps or camera.height)
    return np.stack(np.meshgrid(u, v), axis=-1)


def _pixels(camera: Camera, directions: Floats) -> Floats:
    return camera.project(np.concatenate([directions, np.ones_like(directions[..., :1])], axis=-1))


def _bend(directions: Floats, coefficients: Floats) -> Floats:
    """Distort directions (..., 2) at z = 1."""
    k1, k2, p1, p2, k3 = np.pad(coefficients, (0, 5 - len(coefficients)))
    x, y = directions[..., 0], directions[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([u, v], axis=-1)


def _slope(directions: Floats, coefficients: Floats) -> Floats:
    """Return the derivative (..., 2, 2) of `_bend`."""
    k1, k2, p1, p2, k3 = np.pad(coefficients, (0, 5 - len(coefficients)))
    x, y = directions[..., 0], directions[..., 1]
    r2 = x * x + y * y
    radial, grown = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    mixed = grown * x * y + 2 * p1 * x + 2 * p2 * y
    return np.stack(
        [
            np.stack([radial + grown * x * x + 2 * p1 * y + 6 * p2 * x, mixed], axis=-1),
            np.stack([mixed, radial + grown * y * y + 6 * p1 * y + 2 * p2 * x], axis=-1),
        ],
        axis=-2,
    )
