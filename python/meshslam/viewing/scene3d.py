"""The map as data for the page: meshes, true meshes as wires, and what is known of each object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from meshslam.geometry import AnyArray, Floats, Ints, Pose
from meshslam.maps import Map, MapObject, object_colour
from meshslam.viewing.context import ReportContext, TrueObject
from meshslam.viewing.doubts import doubts, position_sigma_m, seen_share
from meshslam.viewing.from_above import ellipse, footprint, position_covariance
from meshslam.viewing.markup import packed

UNIT_M = 0.001  # of packed vertices: 16 bits reach 32 m from the object's origin
SIGMA_UNIT_M = 0.001  # of packed sigmas: 8 bits reach 0.255 m
WIRE_M = 0.16  # true meshes are thinned to about one vertex in a cube of this side


def scene_origin(scene_map: Map, world_from_camera: Sequence[Pose]) -> Floats:
    """A point (3,) in the middle of a run, in world: 32 bits are enough for what is relative to it."""
    path = np.array([pose.translation for pose in world_from_camera]).reshape(-1, 3)
    centres = np.array([thing.world_from_object.translation for thing in scene_map.objects]).reshape(-1, 3)
    everything = np.concatenate([path, centres])
    middle: Floats = np.round(np.median(everything, axis=0), 3) if len(everything) else np.zeros(3)
    return middle


def scene_data(context: ReportContext, origin: Floats) -> dict[str, Any]:
    """Meshes relative to `origin`, in metres; arrays as base64, equal face lists and mean meshes once.

    `objects`: `matrix` (12, rows of the pose), `vertices` (int16, millimetres in object), `faces` (which list), `sigma`
    (uint8, millimetres) and `seen` (uint8) or null. `truth`: the same with `edges` (uint16, pairs) instead.
    """
    topologies: dict[bytes, int] = {}
    means: dict[bytes, int] = {}
    truth = {true.estimated_id: true for true in context.true_objects if true.estimated_id is not None}
    objects = []
    for thing in context.map.objects:
        shape = _shape(thing, origin, topologies) | _facts(thing, origin) | _error(truth.get(thing.id))
        objects.append(shape | _first(context.stages or {}, thing, origin, means))
    path = np.array([pose.translation for pose in context.world_from_camera]).reshape(-1, 3)
    return {
        "origin": origin.tolist(),
        "ground": ground_height_m(context.map, path) - float(origin[2]),
        "faces": [packed(np.frombuffer(faces, np.uint32)) for faces in topologies],
        "means": [packed(np.frombuffer(mean, np.int16)) for mean in means],
        "objects": objects,
        "truth": [_wire(true, origin) for true in context.true_objects],
    }


def ground_height_m(scene_map: Map, path: Floats) -> float:
    """Height of the ground: where the objects stand, or below the camera."""
    lowest = [float(thing.vertices_in_world[:, 2].min()) for thing in scene_map.objects]
    return float(np.median(lowest)) if lowest else float(np.median(path[:, 2])) - 1.5 if len(path) else 0.0


def _shape(thing: MapObject, origin: Floats, topologies: dict[bytes, int]) -> dict[str, Any]:
    faces = topologies.setdefault(thing.faces.astype(np.uint32).tobytes(), len(topologies))
    sigma, seen = thing.vertex_sigma_m, thing.vertex_observed
    return {
        "id": thing.id,
        "category": thing.category,
        "colour": [int(c) for c in object_colour(thing.id)],
        "matrix": _matrix(thing.world_from_object, origin),
        "vertices": packed(_millimetres(thing.vertices)),
        "faces": faces,
        "sigma": None if sigma is None else packed(np.clip(np.round(sigma / SIGMA_UNIT_M), 0, 255).astype(np.uint8)),
        "seen": None if seen is None else packed(seen.astype(np.uint8)),
    }


def _facts(thing: MapObject, origin: Floats) -> dict[str, Any]:
    """What the page tells of an object beside its mesh."""
    covariance = position_covariance(thing)
    return {
        "dimensions": np.round(thing.dimensions, 3).tolist(),
        "views": thing.views,
        "frames": None if thing.first_frame is None else [thing.first_frame, thing.last_frame],
        "mask_iou": _short(thing.mask_iou),
        "position_sigma": _short(position_sigma_m(thing)),
        "seen_share": _short(seen_share(thing)),
        "footprint": np.round(footprint(thing) - origin[:2], 3).tolist(),
        "ellipse": None if covariance is None else [round(v, 5) for v in ellipse(covariance)],
        "doubts": doubts(thing),
    }


def _error(true: TrueObject | None) -> dict[str, Any]:
    if true is None:
        return {"error": None}
    return {
        "error": {
            "centre": _short(true.centre_error_m),
            "yaw": _short(true.yaw_error_deg),
            "voxel_iou": _short(true.voxel_iou),
        }
    }


def _first(
    stages: Mapping[int, tuple[Pose, Floats]], thing: MapObject, origin: Floats, means: dict[bytes, int]
) -> dict[str, Any]:
    """The category's mean at the object's first estimate."""
    if thing.id not in stages:
        return {}
    pose, mean = stages[thing.id]
    if len(mean) != len(thing.vertices):
        return {}
    which = means.setdefault(_millimetres(mean).tobytes(), len(means))
    return {"first": {"matrix": _matrix(pose, origin), "mean": which}}


def _wire(true: TrueObject, origin: Floats) -> dict[str, Any]:
    vertices, edges = thinned_edges(true.vertices, true.faces)
    return {
        "id": true.id,
        "estimate": true.estimated_id,
        "matrix": _matrix(true.world_from_object, origin),
        "vertices": packed(_millimetres(vertices)),
        "edges": packed(edges.astype(np.uint16)),
    }


def thinned_edges(vertices: Floats, faces: Ints, side_m: float = WIRE_M) -> tuple[Floats, Ints]:
    """A mesh's edges (n, 2) between the means (m, 3) of its vertices in cubes of a side: a wire that can be seen."""
    cells = np.floor(vertices / side_m).astype(np.int64)
    _, which = np.unique(cells, axis=0, return_inverse=True)
    which = which.ravel()
    count = np.bincount(which)
    means = np.column_stack([np.bincount(which, vertices[:, axis]) / count for axis in range(3)])
    corners = which[faces]
    pairs = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    edges = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
    return means, edges


def _matrix(pose: Pose, origin: Floats) -> list[float]:
    rows: list[float] = np.round(np.column_stack([pose.rotation, pose.translation - origin]), 6).ravel().tolist()
    return rows


def _millimetres(vertices: Floats) -> AnyArray:
    limit = np.iinfo(np.int16).max
    return np.clip(np.round(vertices / UNIT_M), -limit, limit).astype(np.int16)


def _short(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else round(float(value), 4)
