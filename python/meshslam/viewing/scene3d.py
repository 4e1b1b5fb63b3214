"""The map as data for the viewer in `assets/viewer.js`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from meshslam.geometry import Camera, Floats, Pose
from meshslam.maps import Map, MapObject, object_colour
from meshslam.viewing.markup import packed

UNIT_M = 0.001  # of packed vertices: 16 bits reach 32 m from the object's origin
SIGMA_UNIT_M = 0.001  # of packed sigmas: 8 bits reach 0.255 m
FRUSTA = 40
FRUSTUM_DEPTH_M, FRUSTUM_SPACING_M = 1.0, 3.0
PATH_POINTS = 4000


def scene_data(scene_map: Map, camera: Camera, world_from_camera: Sequence[Pose]) -> dict[str, Any]:
    """Meshes, path and frusta, relative to `origin`, in metres; arrays as base64, equal face lists once.

    `objects`: `matrix` (12, rows of the pose), `vertices` (int16, millimetres in object), `faces` (which list), `sigma`
    (uint8, millimetres) and `seen` (uint8) or null. `frusta`: (n, 5, 3), the centre and the corners of the image.
    """
    path = np.array([pose.translation for pose in world_from_camera]).reshape(-1, 3)
    centres = np.array([thing.world_from_object.translation for thing in scene_map.objects]).reshape(-1, 3)
    everything = np.concatenate([path, centres])
    origin = np.round(np.median(everything, axis=0), 3) if len(everything) else np.zeros(3)
    topologies: dict[bytes, int] = {}
    objects = [_object(thing, origin, topologies) for thing in scene_map.objects]
    frusta = [_frustum(camera, pose) - origin for pose in _spread(world_from_camera, FRUSTA)]
    shown = path[:: len(path) // PATH_POINTS + 1] - origin
    return {
        "origin": origin.tolist(),
        "ground": _ground(scene_map, path) - float(origin[2]),
        "faces": [packed(np.frombuffer(faces, np.uint32)) for faces in topologies],
        "objects": objects,
        "path": packed(shown.astype(np.float32)),
        "frusta": packed(np.array(frusta, np.float32).reshape(-1, 5, 3)),
    }


def _object(thing: MapObject, origin: Floats, topologies: dict[bytes, int]) -> dict[str, Any]:
    pose = np.column_stack([thing.world_from_object.rotation, thing.world_from_object.translation - origin])
    faces = topologies.setdefault(thing.faces.astype(np.uint32).tobytes(), len(topologies))
    limit = np.iinfo(np.int16).max
    sigma, seen = thing.vertex_sigma_m, thing.vertex_observed
    return {
        "id": thing.id,
        "name": f"{thing.category} {thing.id}",
        "colour": [round(int(c) / 255, 4) for c in object_colour(thing.id)],
        "matrix": np.round(pose, 6).ravel().tolist(),
        "vertices": packed(np.clip(np.round(thing.vertices / UNIT_M), -limit, limit).astype(np.int16)),
        "faces": faces,
        "sigma": None if sigma is None else packed(np.clip(np.round(sigma / SIGMA_UNIT_M), 0, 255).astype(np.uint8)),
        "seen": None if seen is None else packed(seen.astype(np.uint8)),
    }


def _frustum(camera: Camera, world_from_camera: Pose) -> Floats:
    """Centre and corners (5, 3) of what an image shows, in world."""
    right, bottom = camera.width - 0.5, camera.height - 0.5
    corners = camera.rays(np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]]))
    return world_from_camera.transform(np.concatenate([np.zeros((1, 3)), FRUSTUM_DEPTH_M * corners]))


def _spread(poses: Sequence[Pose], count: int) -> list[Pose]:
    """At most `count` poses, spread evenly, hardly nearer to each other than FRUSTUM_SPACING_M."""
    if not poses:
        return []
    path = np.array([pose.translation for pose in poses])
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    wanted = min(count, len(poses), 2 + int(length / FRUSTUM_SPACING_M))
    return [poses[i] for i in np.unique(np.linspace(0, len(poses) - 1, wanted).round().astype(int)).tolist()]


def _ground(scene_map: Map, path: Floats) -> float:
    """Height of the grid: where the objects stand, or below the camera."""
    lowest = [float(thing.vertices_in_world[:, 2].min()) for thing in scene_map.objects]
    return float(np.median(lowest)) if lowest else float(np.median(path[:, 2])) - 1.5 if len(path) else 0.0
