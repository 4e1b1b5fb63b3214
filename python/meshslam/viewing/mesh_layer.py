"""Meshes drawn as a translucent layer over an image, nearest in front."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from meshslam.geometry import Bools, Bytes, Camera, Floats, Ints, Pose, Rendering, render
from meshslam.maps import Map, MapObject, object_colour

Box = tuple[float, float, float, float]  # x0, y0, x1, y1: px
Rect = tuple[int, int, int, int]  # x0, y0, width, height: px
Samples = NDArray[np.float32]  # (h, w, 4), BGR and opacity
SAMPLES = 2  # per pixel and axis
FILL, FAINT_FILL, EDGE = 0.42, 0.14, 0.95  # opacity
EDGE_PX = 1.5
NEAR_M = 0.1  # faces are cut there


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
class Patch:
    """A rectangle of a picture."""

    bgra: Bytes  # (h, w, 4), colours not multiplied with opacity
    corner: tuple[int, int]  # x, y of its first pixel

    @property
    def rect(self) -> Rect:
        """Where it is."""
        return (*self.corner, self.bgra.shape[1], self.bgra.shape[0])

    @property
    def inside(self) -> tuple[slice, slice]:
        """Rows and columns of the picture."""
        (x, y), (height, width) = self.corner, self.bgra.shape[:2]
        return slice(y, y + height), slice(x, x + width)


@dataclass(frozen=True, eq=False)
class MeshLayer:
    """A picture of meshes, to be laid over an image of the same view; where there are none it is not kept."""

    patches: tuple[Patch, ...]  # apart from each other
    boxes: dict[int, Box]  # what is visible of each object, in pixels of the image

    def over(self, image: Bytes) -> Bytes:
        """A copy of a BGR image (h, w, 3) with the layer over it."""
        out = image.copy()
        for patch in self.patches:
            out[patch.inside] = laid_over(image[patch.inside], patch.bgra)
        return out


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
    camera_from_world = world_from_camera.inverse()
    placed = [Placed(shape, camera_from_world @ shape.world_from_object) for shape in shapes]
    reached = [(thing, rect) for thing in placed if (rect := _reached(camera, thing)) is not None]
    fine, patches, boxes = scaled_camera(camera, SAMPLES), [], {}
    for rect, group in _groups(reached):
        x, y, width, height = (SAMPLES * side for side in rect)
        meshes = [(thing.camera_from_object, thing.shape.vertices, thing.shape.faces) for thing in group]
        drawn = render(fine, meshes, (x, y, width, height))
        shown = [thing.shape for thing in group]
        patches.append(Patch(_reduced(_coloured(drawn, shown, world_from_camera, faint)), rect[:2]))
        found = {s.id: box for i, s in enumerate(shown) if (box := _box(drawn.object_index == i, rect)) is not None}
        boxes.update(found)
    return MeshLayer(tuple(patches), boxes)


def laid_over(image: Bytes, layer: Bytes) -> Bytes:
    """Lay a BGRA layer (h, w, 4) over a BGR image (h, w, 3)."""
    opacity = layer[..., 3:].astype(np.float32) / 255
    mixed = image * (1 - opacity) + layer[..., :3] * opacity
    return np.round(mixed).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class Placed:
    """A shape before the camera."""

    shape: Shape
    camera_from_object: Pose


def _reached(camera: Camera, thing: Placed) -> Rect | None:
    """The part of the image that a mesh can reach, with a margin for its outline; None if it reaches no pixel."""
    corners = thing.camera_from_object.transform(thing.shape.vertices)
    if not len(corners) or corners[:, 2].max() < NEAR_M:
        return None
    if corners[:, 2].min() < NEAR_M:  # what the near plane cuts has other corners
        return 0, 0, camera.width, camera.height
    pixels, limits = camera.project(corners), np.array([camera.width, camera.height])
    low = np.clip(np.floor(pixels.min(axis=0) - EDGE_PX), 0, limits).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0) + EDGE_PX) + 1, 0, limits).astype(int)
    (x0, y0), (x1, y1) = low.tolist(), high.tolist()
    return (x0, y0, x1 - x0, y1 - y0) if x1 > x0 and y1 > y0 else None


def _groups(reached: Sequence[tuple[Placed, Rect]]) -> list[tuple[Rect, list[Placed]]]:
    """Shapes whose rectangles overlap, and the rectangle around them; the groups' rectangles are apart."""
    groups: list[tuple[Rect, list[Placed]]] = []
    for thing, rect in reached:
        around, members = rect, [thing]
        while touched := [group for group in groups if _overlap(group[0], around)]:
            around = _around([around, *(other for other, _ in touched)])
            members = [*(member for _, others in touched for member in others), *members]
            groups = [group for group in groups if group not in touched]
        groups.append((around, members))
    return groups


def _overlap(one: Rect, other: Rect) -> bool:
    return all(one[axis] < other[axis] + other[axis + 2] and other[axis] < one[axis] + one[axis + 2] for axis in (0, 1))


def _around(rects: Sequence[Rect]) -> Rect:
    """The smallest rectangle around others."""
    corners = np.array([(x, y, x + width, y + height) for x, y, width, height in rects])
    (x0, y0), (x1, y1) = corners[:, :2].min(axis=0).tolist(), corners[:, 2:].max(axis=0).tolist()
    return x0, y0, x1 - x0, y1 - y0


def _coloured(drawn: Rendering, shapes: Sequence[Shape], world_from_camera: Pose, faint: Collection[int]) -> Samples:
    """What each sample shows, colours multiplied with their opacity: a face, an object's outline, or nothing."""
    index = drawn.object_index
    samples = np.zeros((*index.shape, 4), np.float32)
    inside = np.flatnonzero(index >= 0)
    which, face = index.ravel()[inside], drawn.face_index.ravel()[inside]
    fills = [np.float32(FAINT_FILL if shape.id in faint else FILL) for shape in shapes]
    lit = [_with_opacity(_lit_faces(s, world_from_camera), fill) for s, fill in zip(shapes, fills, strict=True)]
    outlines = _with_opacity(np.array([shape.colour_bgr for shape in shapes]), np.float32(EDGE))
    starts = np.cumsum([0] + [len(rows) for rows in lit])
    on_edge = _edges(index, drawn.inverse_depth).ravel()[inside]
    row = np.where(on_edge, starts[-1] + which, starts[which] + face)
    samples.reshape(-1, 4)[inside] = np.concatenate([*lit, outlines])[row]
    return samples


def _with_opacity(colours: Floats, opacity: np.float32) -> Samples:
    rows = np.full((len(colours), 4), opacity, np.float32)
    rows[:, :3] = colours.astype(np.float32) * opacity
    return rows


def _lit_faces(shape: Shape, world_from_camera: Pose) -> Floats:
    """Colour (F, 3) of each face under a light above and behind the camera."""
    corners = shape.world_from_object.transform(shape.vertices)[shape.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    light = np.array([0.0, 0.0, 0.75]) - 0.65 * world_from_camera.rotation[:, 2]
    shade = np.clip(normals @ (light / np.linalg.norm(light)), 0, 1)[:, None]
    lit: Floats = np.clip(shape.colour_bgr * (0.35 + 0.75 * shade) + 60 * shade**4, 0, 255)
    return lit


def _edges(index: NDArray[np.int32], nearness: Floats) -> Bools:
    """Samples of an object beside another that is farther, or beside none."""
    found, width = np.zeros(index.size, bool), index.shape[1]
    near = nearness.ravel()
    for step in range(1, round(EDGE_PX * SAMPLES) + 1):
        below = index[:-step], index[step:], step * width
        beside = index[:, :-step], index[:, step:], step
        for here, there, apart in (below, beside):
            rows, columns = np.divmod(np.flatnonzero(here != there), max(1, here.shape[1]))
            at = rows * width + columns
            closer = near[at] - near[at + apart]
            found[at[closer > 0]] = True
            found[at[closer < 0] + apart] = True
    return found.reshape(index.shape)


def _box(mask: Bools, rect: Rect) -> Box | None:
    """What is visible of one object, in pixels of the image; its samples in `rect` are given."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    ends = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]) / SAMPLES - 0.5
    x0, y0, x1, y1 = (ends + (*rect[:2], *rect[:2])).tolist()
    return x0, y0, x1, y1


def _reduced(samples: Samples) -> Bytes:
    """Average samples to pixels, and divide the colours by their opacity."""
    size = samples.shape[1] // SAMPLES, samples.shape[0] // SAMPLES
    small = np.asarray(cv2.resize(samples, size, interpolation=cv2.INTER_AREA), np.float32)
    small[..., :3] /= np.maximum(small[..., 3:], 1e-6)
    small[..., 3] *= 255
    return np.rint(small, out=small).astype(np.uint8)
