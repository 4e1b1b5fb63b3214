"""What a lens sees: the sides of a cube about the camera are drawn, and each raw pixel takes what lies on its ray."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from meshslam.geometry import Bools, Camera, Floats, Ints, Pose, Rendering, render
from meshslam.sequences import Distortion

_LEAST_FINER = 2  # pixels of a side for one of the raw image's centre, along an axis
_MARGIN_PX = 2  # around what is needed of a side
_SIDES = ((0.0, 0.0), (90.0, 0.0), (-90.0, 0.0), (0.0, 90.0), (0.0, -90.0), (180.0, 0.0))  # turns about y, then x


@dataclass(frozen=True, eq=False)
class Side:
    """A pinhole camera in one direction, and which raw pixels (h, w) see it, at which of its pixels."""

    camera: Camera
    camera_from_side: Pose
    here: Bools
    columns: Floats  # (h, w) float32; elsewhere outside
    rows: Floats

    @property
    def stretch(self) -> Floats:
        """By how much the range of points exceeds their depth in this side, (n,) for the pixels that are here."""
        pixels = np.stack([self.columns[self.here], self.rows[self.here]], axis=-1).astype(float)
        length: Floats = np.linalg.norm(self.camera.rays(pixels), axis=-1)
        return length


@lru_cache(maxsize=8)
def sides_of(lens: Distortion, finer: int) -> tuple[Side, ...]:
    """The sides that a lens needs, with `finer` samples along each axis of a raw pixel."""
    raw = lens.raw_camera
    shift = (finer - 1) / 2
    columns, rows = np.meshgrid(np.arange(finer * raw.width), np.arange(finer * raw.height))
    rays = lens.raw_rays((np.stack([columns, rows], axis=-1) - shift) / finer)
    nearest = np.argmax(np.nan_to_num(rays @ np.array([_turn(*side)[:, 2] for side in _SIDES]).T, nan=-1.0), axis=-1)
    nearest = np.where(np.isfinite(rays).all(-1), nearest, -1)
    focal_px = max(finer, _LEAST_FINER) * raw.fx
    return tuple(
        _side(_turn(*side), nearest == k, rays, focal_px) for k, side in enumerate(_SIDES) if (nearest == k).any()
    )


def _turn(yaw_deg: float, pitch_deg: float) -> Floats:
    """The rotation camera_from_side."""
    cy, sy, cp, sp = (f(np.radians(a)) for a in (yaw_deg, pitch_deg) for f in (np.cos, np.sin))
    about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]])
    turn: Floats = about_y @ about_x
    return turn


def _side(camera_from_side: Floats, here: Bools, rays: Floats, focal_px: float) -> Side:
    directions = rays[here] @ camera_from_side
    places = focal_px * directions[:, :2] / directions[:, 2:]
    first = np.floor(places.min(0)) - _MARGIN_PX
    width, height = (np.ceil(places.max(0)) - first).astype(int) + 1 + _MARGIN_PX
    maps = np.full((2, *here.shape), -1.0, np.float32)
    maps[:, here] = (places - first).T
    camera = Camera(int(width), int(height), focal_px, focal_px, -float(first[0]), -float(first[1]))
    return Side(camera, Pose(camera_from_side, np.zeros(3)), here, maps[0], maps[1])


def image_through(
    lens: Distortion, finer: int, draw: Callable[[Camera, Pose], Floats], *, is_smooth: bool = True
) -> Floats:
    """The raw image (finer h, finer w, 3) of what `draw` gives for a camera and camera_from_side; smooth: bilinear."""
    raw = lens.raw_camera
    image: Floats = np.zeros((finer * raw.height, finer * raw.width, 3))
    for side in sides_of(lens, finer):
        drawn = draw(side.camera, side.camera_from_side)
        how = cv2.INTER_LINEAR if is_smooth else cv2.INTER_NEAREST
        image[side.here] = cv2.remap(drawn, side.columns, side.rows, how)[side.here]
    return image


def render_through(lens: Distortion | None, camera: Camera, meshes: Sequence[tuple[Pose, Floats, Ints]]) -> Rendering:
    """Draw meshes (camera_from_mesh, vertices, faces) as a lens, or without one the pinhole camera, sees them.

    With a lens `inverse_depth` is that of the range, the distance from the camera.
    """
    if lens is None:
        return render(camera, meshes)
    shape = (lens.raw_camera.height, lens.raw_camera.width)
    objects, faces, inverse = np.full(shape, -1, np.int32), np.full(shape, -1, np.int32), np.zeros(shape)
    for side in sides_of(lens, 1):
        side_from_camera = side.camera_from_side.inverse()
        drawn = render(side.camera, [(side_from_camera @ pose, v, f) for pose, v, f in meshes])
        at = np.round(side.rows[side.here]).astype(int), np.round(side.columns[side.here]).astype(int)
        objects[side.here], faces[side.here] = drawn.object_index[at], drawn.face_index[at]
        inverse[side.here] = drawn.inverse_depth[at] / side.stretch
    return Rendering(objects, faces, inverse)
