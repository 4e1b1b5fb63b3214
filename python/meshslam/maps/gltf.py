"""A map as binary glTF, for any viewer."""

from __future__ import annotations

import colorsys
import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.categories import icosphere
from meshslam.files import write_atomically
from meshslam.geometry import AnyArray, Bytes, Floats, Ints, convex_hull
from meshslam.maps.map import Map
from meshslam.maps.objects import MapObject
from meshslam.maps.trajectory import Trajectory

# glTF is y up, z towards the viewer: (x, y, z)_gltf = (x, z, -y)_world
GLTF_FROM_WORLD = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
PATH_RADIUS_M, PATH_SIDES = 0.06, 8
PATH_COLOUR = np.array([235, 110, 20, 255], np.uint8)
UNSURE_COLOUR = np.array([150.0, 150.0, 150.0])
_BYTE, _INTEGER, _FLOAT = 5121, 5125, 5126  # glTF's component types
_VERTICES, _CORNERS = 34962, 34963  # and what a view of the buffer is for
SURE_SIGMA_M, UNSURE_SIGMA_M = 0.03, 0.15


@dataclass(frozen=True, eq=False)
class Drawn:
    """A coloured mesh in the file."""

    name: str
    vertices: Floats  # (V, 3), metres
    faces: Ints  # (F, 3)
    colours: Bytes  # (V, 4), linear
    world_from_mesh: Floats  # (4, 4)


def to_glb(scene_map: Map, trajectory: Trajectory | None = None) -> bytes:
    """Draw every object in its own colour, grey where its surface is not known well, and the path as a tube."""
    drawn = [_object(thing) for thing in scene_map.objects]
    if trajectory is not None and len(trajectory):
        drawn.append(_tube(trajectory.positions_in_world))
    return glb_of(drawn or [_mark()])


def save_glb(path: Path, scene_map: Map, trajectory: Trajectory | None = None) -> None:
    """Write `to_glb`, whole or not at all."""
    write_atomically(Path(path), to_glb(scene_map, trajectory))


def object_colour(number: int) -> Bytes:
    """Return the colour (3,) of an object's id: neighbours in number are far apart in hue."""
    hue = (number * 0.618033988749895) % 1.0
    return np.round(255 * np.array(colorsys.hsv_to_rgb(hue, 0.65, 0.9))).astype(np.uint8)


def vertex_colours(thing: MapObject) -> Bytes:
    """Colours (V, 4) of an object's vertices."""
    colour = np.tile(object_colour(thing.id).astype(float), (len(thing.vertices), 1))
    if thing.vertex_sigma_m is not None:
        span = np.log(UNSURE_SIGMA_M / SURE_SIGMA_M)
        share = np.clip(np.log(np.maximum(thing.vertex_sigma_m, 1e-9) / SURE_SIGMA_M) / span, 0, 1)[:, None]
        colour = (1 - share) * colour + share * UNSURE_COLOUR
    return np.column_stack([np.round(colour), np.full(len(colour), 255)]).astype(np.uint8)


def _object(thing: MapObject) -> Drawn:
    name, colours = f"{thing.category}_{thing.id}", linear(vertex_colours(thing))
    return Drawn(name, thing.vertices, thing.faces, colours, thing.world_from_object.matrix)


def linear(colours: Bytes) -> Bytes:
    """Colours (n, 4) of sRGB as glTF's COLOR_0 has them: linear (IEC 61966-2-1), the opacity as it is."""
    share = colours[:, :3] / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.column_stack([np.round(255 * light), colours[:, 3]]).astype(np.uint8)


def _mark() -> Drawn:
    """Draw a 10 cm box: an empty scene is no valid glTF."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = convex_hull(corners)
    faces = np.zeros((0, 3), np.int64) if faces is None else faces
    return Drawn("empty", 0.1 * (corners - 0.5), faces, np.full((8, 4), 255, np.uint8), np.eye(4))


def _tube(points: Floats) -> Drawn:
    """Draw a thin tube along points (n, 3); a single point becomes a ball."""
    keep = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-3])
    points = points[keep]
    if len(points) < 2:
        ball = icosphere(2)
        vertices, faces = 2 * PATH_RADIUS_M * ball.vertices + points[0], ball.faces
    else:
        vertices, faces = _tube_parts(points)
    return Drawn("path", vertices, faces, linear(np.tile(PATH_COLOUR, (len(vertices), 1))), np.eye(4))


def _tube_parts(points: Floats) -> tuple[Floats, Ints]:
    """Rings of vertices about each point, square to the path, and the quads between them."""
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    level = np.abs(along[:, 2:]) < 0.95
    side = np.cross(along, np.where(level, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]]))
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    up = np.cross(side, along)
    angle = np.arange(PATH_SIDES) * (2 * np.pi / PATH_SIDES)
    ring = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * up[:, None]
    vertices = (points[:, None] + PATH_RADIUS_M * ring).reshape(-1, 3)
    start = PATH_SIDES * np.arange(len(points) - 1)[:, None] + np.arange(PATH_SIDES)
    beside = PATH_SIDES * np.arange(len(points) - 1)[:, None] + (np.arange(PATH_SIDES) + 1) % PATH_SIDES
    quads = np.stack([start, beside, beside + PATH_SIDES, start + PATH_SIDES], axis=-1).reshape(-1, 4)
    return vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int64)


def glb_of(drawn: Sequence[Drawn]) -> bytes:
    """Binary glTF 2.0: a node a mesh, z up turned to y up."""
    views: list[bytes] = []
    accessors: list[dict[str, Any]] = []

    def put(array: AnyArray, kind: str, component: int, target: int, **more: Any) -> int:  # noqa: ANN401 # as glTF has it
        rows = array.reshape(len(array), -1)
        limits = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        accessors.append(
            {"bufferView": len(views), "componentType": component, "count": len(rows), "type": kind, **limits, **more}
        )
        views.append(array.tobytes())
        targets.append(target)
        return len(accessors) - 1

    targets: list[int] = []
    meshes, nodes = [], []
    for number, thing in enumerate(drawn):
        vertices = thing.vertices.astype("<f4")
        attributes = {
            "POSITION": put(vertices, "VEC3", _FLOAT, _VERTICES),
            "NORMAL": put(vertex_normals(thing.vertices, thing.faces).astype("<f4"), "VEC3", _FLOAT, _VERTICES),
            "COLOR_0": put(thing.colours, "VEC4", _BYTE, _VERTICES, normalized=True),
        }
        corners = put(thing.faces.astype("<u4").ravel(), "SCALAR", _INTEGER, _CORNERS)
        meshes.append({"name": thing.name, "primitives": [{"attributes": attributes, "indices": corners, "mode": 4}]})
        matrix = (GLTF_FROM_WORLD @ thing.world_from_mesh).T.ravel().tolist()  # glTF writes columns
        nodes.append({"name": thing.name, "mesh": number, "matrix": matrix})
    starts = np.cumsum([0] + [len(view) for view in views]).tolist()
    document = {
        "asset": {"version": "2.0", "generator": "meshslam"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(view), "target": target}
            for start, view, target in zip(starts, views, targets, strict=False)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    chunks = _chunk(b"JSON", text, b" ") + _chunk(b"BIN\0", b"".join(views), b"\0")
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _chunk(kind: bytes, content: bytes, filling: bytes) -> bytes:
    whole = content + filling * (-len(content) % 4)
    return struct.pack("<I4s", len(whole), kind) + whole


def vertex_normals(vertices: Floats, faces: Ints) -> Floats:
    """Unit normals (V, 3): those of the faces around, weighted by their angles (Thürmer and Wüthrich 1998)."""
    corners = vertices[faces]
    normals = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    total = np.zeros((len(vertices), 3))
    for k in range(3):
        ahead, behind = (_unit(corners[:, (k + step) % 3] - corners[:, k]) for step in (1, 2))
        angle = np.arccos(np.clip((ahead * behind).sum(axis=1), -1, 1))
        np.add.at(total, faces[:, k], normals * angle[:, None])
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 1e-12, total / np.maximum(length, 1e-12), [0.0, 0.0, 1.0])


def _unit(vectors: Floats) -> Floats:
    found: Floats = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    return found
