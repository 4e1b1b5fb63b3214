"""Meshes drawn as a translucent layer over an image, nearest in front."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from meshslam.geometry import Bools, Bytes, Camera, Floats, Ints, Pose, Rendering, render
from meshslam.maps import Map, MapObject, object_colour

Box = tuple[float, float, float, float]  # x0, y0, x1, y1: px
SAMPLES = 2  # per pixel and axis
FILL, FAINT_FILL, EDGE = 0.42, 0.14, 0.95  # opacity
EDGE_PX = 1.5


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh at a place, with a number and a colour."""

    id: int
    world_from_object: Pose
    vertices: Floats  # (V, 3), in object
    faces: Ints  # (F, 3)

    @property
    def colour_bgr(self) -> Floats:
        """The colour (3,) that all pictures give to this number, 0 to 255."""
        return object_colour(self.id)[::-1].astype(float)


@dataclass(frozen=True, eq=False)
class MeshLayer:
    """A picture of meshes, to be laid over an image of the same view."""

    bgra: Bytes  # (h, w, 4), colours not multiplied with opacity
    boxes: dict[int, Box]  # what is visible of each object, in pixels of the layer


def shapes_of(scene_map: Map) -> tuple[Shape, ...]:
    """Every object of a map."""
    return tuple(shape_of(thing) for thing in scene_map.objects)


def shape_of(thing: MapObject) -> Shape:
    """An object of a map."""
    return Shape(thing.id, thing.world_from_object, thing.vertices, thing.faces)


def scaled_camera(camera: Camera, scale: float) -> Camera:
    """The same view on `scale` times as many pixels a side, rounded."""
    width, height = max(1, round(camera.width * scale)), max(1, round(camera.height * scale))
    x, y = width / camera.width, height / camera.height
    centre = ((camera.cx + 0.5) * x - 0.5, (camera.cy + 0.5) * y - 0.5)
    return Camera(width, height, camera.fx * x, camera.fy * y, *centre, camera.skew * x)


def mesh_layer(
    camera: Camera, world_from_camera: Pose, shapes: Sequence[Shape], faint: Collection[int] = ()
) -> MeshLayer:
    """Draw shapes lit, translucent and outlined in their colours; those numbered in `faint` with hardly any filling."""
    fine = scaled_camera(camera, SAMPLES)
    camera_from_world = world_from_camera.inverse()
    drawn = render(fine, [(camera_from_world @ s.world_from_object, s.vertices, s.faces) for s in shapes])
    inside = drawn.object_index >= 0
    bgra = np.zeros((fine.height, fine.width, 4), np.float32)
    if inside.any():
        edge = _edges(drawn)
        which = drawn.object_index[inside]
        starts = np.cumsum([0] + [len(s.faces) for s in shapes])
        lit = np.concatenate([_lit_faces(s, world_from_camera) for s in shapes])
        plain = np.array([s.colour_bgr for s in shapes])
        fill = np.array([FAINT_FILL if s.id in faint else FILL for s in shapes])
        on_edge = edge[inside]
        bgra[inside, :3] = np.where(on_edge[:, None], plain[which], lit[starts[which] + drawn.face_index[inside]])
        bgra[inside, 3] = np.where(on_edge, EDGE, fill[which])
    boxes = {s.id: box for i, s in enumerate(shapes) if (box := _box(drawn.object_index == i)) is not None}
    return MeshLayer(_reduced(bgra, camera), boxes)


def laid_over(image: Bytes, layer: Bytes) -> Bytes:
    """Lay a BGRA layer (h, w, 4) over a BGR image (h, w, 3)."""
    opacity = layer[..., 3:].astype(np.float32) / 255
    mixed = image * (1 - opacity) + layer[..., :3] * opacity
    return np.round(mixed).astype(np.uint8)


def _lit_faces(shape: Shape, world_from_camera: Pose) -> Floats:
    """Colour (F, 3) of each face under a light above and behind the camera."""
    corners = shape.world_from_object.transform(shape.vertices)[shape.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    light = np.array([0.0, 0.0, 0.75]) - 0.65 * world_from_camera.rotation[:, 2]
    shade = np.clip(normals @ (light / np.linalg.norm(light)), 0, 1)[:, None]
    lit: Floats = np.clip(shape.colour_bgr * (0.35 + 0.75 * shade) + 60 * shade**4, 0, 255)
    return lit


def _edges(drawn: Rendering) -> Bools:
    """Pixels of an object beside another that is farther, or beside none."""
    index, nearness = drawn.object_index, drawn.inverse_depth
    found = np.zeros(index.shape, bool)
    for step in range(1, round(EDGE_PX * SAMPLES) + 1):
        for here, there in _pairs(step):
            differs = index[here] != index[there]
            found[here] |= differs & (nearness[here] > nearness[there])
            found[there] |= differs & (nearness[there] > nearness[here])
    return found


def _pairs(step: int) -> Iterable[tuple[tuple[slice, slice], tuple[slice, slice]]]:
    """Pixels and those `step` below, then those `step` to the right."""
    everything, first, last = slice(None), slice(None, -step), slice(step, None)
    return (((first, everything), (last, everything)), ((everything, first), (everything, last)))


def _box(mask: Bools) -> Box | None:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    ends = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]) / SAMPLES - 0.5
    x0, y0, x1, y1 = ends.tolist()
    return x0, y0, x1, y1


def _reduced(bgra: Floats | np.ndarray[tuple[int, ...], np.dtype[np.float32]], camera: Camera) -> Bytes:
    """Average samples to pixels, colours weighted with their opacity."""
    bgra = np.concatenate([bgra[..., :3] * bgra[..., 3:], bgra[..., 3:]], axis=-1)
    small = cv2.resize(bgra, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    colours = small[..., :3] / np.maximum(small[..., 3:], 1e-6)
    return np.round(np.concatenate([colours, 255 * small[..., 3:]], axis=-1)).astype(np.uint8)
