"""A map as binary glTF, for any viewer."""

from __future__ import annotations

import colorsys
from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshslam.files import write_atomically
from meshslam.geometry import Bytes, Camera, Floats, Ints
from meshslam.maps.map import Map
from meshslam.maps.objects import MapObject
from meshslam.maps.trajectory import Trajectory

if TYPE_CHECKING:
    import trimesh

# glTF is y up, z towards the viewer: (x, y, z)_gltf = (x, z, -y)_world
GLTF_FROM_WORLD = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_CAMERA_FROM_GLTF_CAMERA = np.diag([1.0, -1.0, -1.0, 1.0])  # glTF's looks along -z, y up
PATH_RADIUS_M, PATH_SIDES = 0.06, 8
PATH_COLOUR = np.array([235, 110, 20, 255], np.uint8)
UNSURE_COLOUR = np.array([150.0, 150.0, 150.0])
SURE_SIGMA_M, UNSURE_SIGMA_M = 0.03, 0.15


def to_glb(
    scene_map: Map,
    trajectory: Trajectory | None = None,
    camera: Camera | None = None,
    frame_ids: Sequence[int] | None = None,
) -> bytes:
    """Draw every object in its own colour, grey where its surface is not known well, and the path as a tube.

    Nodes of objects have their properties as `extras`. With `camera` each pose of the trajectory is a camera's node,
    called by its frame's number.
    """
    import trimesh  # slow to import
    from trimesh.exchange.gltf import export_glb

    scene, made = trimesh.Scene(), _MadeWhenAsked()
    for thing in scene_map.objects:
        made[f"{thing.category}_{thing.id}"] = partial(_coloured, thing)
    transforms = [GLTF_FROM_WORLD @ thing.world_from_object.matrix for thing in scene_map.objects]
    if trajectory is not None and len(trajectory):
        made["path"] = partial(_tube, trajectory.positions_in_world)
    if not made:
        made["empty"] = _mark
    for name, transform in zip_longest(made.keys(), transforms, fillvalue=GLTF_FROM_WORLD):
        place: Callable[..., None] = scene.graph.update
        place(frame_to=name, matrix=transform, metadata=None, geometry=name, geometry_flags={"visible": True})
    scene.geometry = made
    export: Callable[..., bytes] = export_glb
    return export(
        scene, include_normals=True, tree_postprocessor=partial(_complete, scene_map, trajectory, camera, frame_ids)
    )


class _MadeWhenAsked(OrderedDict[str, "Callable[[], trimesh.Trimesh]"]):
    """Geometries of a scene by name, each made when it is written: trimesh takes 300 KB for an object."""

    def items(self) -> Any:  # noqa: ANN401 # what trimesh goes through, not what is held
        """Each name with its geometry, made now."""
        return ((name, make()) for name, make in super().items())


def _complete(
    scene_map: Map,
    trajectory: Trajectory | None,
    camera: Camera | None,
    frame_ids: Sequence[int] | None,
    tree: dict[str, Any],
) -> None:
    """Add to a glTF tree what trimesh does not write: properties of objects, cameras."""
    properties = {f"{thing.category}_{thing.id}": _properties(thing) for thing in scene_map.objects}
    for node in tree["nodes"]:
        if node.get("name") in properties:
            node["extras"] = properties[node["name"]]
    if camera is None or trajectory is None or not len(trajectory):
        return
    tree["cameras"] = [_perspective(camera)]
    names = range(len(trajectory)) if frame_ids is None else frame_ids
    for name, pose in zip(names, trajectory.world_from_camera, strict=True):
        matrix = GLTF_FROM_WORLD @ pose.matrix @ _CAMERA_FROM_GLTF_CAMERA
        node = {"name": f"camera_{name}", "camera": 0, "matrix": (np.round(matrix.T.ravel(), 9) + 0.0).tolist()}
        tree["scenes"][0]["nodes"].append(len(tree["nodes"]))
        tree["nodes"].append(node)


def _properties(thing: MapObject) -> dict[str, Any]:
    """What a viewer shows of an object, metres; what is not known is left out."""
    sigma = None if thing.vertex_sigma_m is None else round(float(np.median(thing.vertex_sigma_m)), 6)
    observed = None if thing.vertex_observed is None else round(float(np.mean(thing.vertex_observed)), 6)
    found = {
        "id": thing.id,
        "category": thing.category,
        "dimensions_m": np.round(thing.dimensions, 6).tolist(),
        "views": thing.views,
        "mask_iou": None if thing.mask_iou is None else round(thing.mask_iou, 6),
        "surface_sigma_median_m": sigma,
        "observed_share": observed,
    }
    return {name: value for name, value in found.items() if value is not None}


def _perspective(camera: Camera) -> dict[str, Any]:
    """The field of view; glTF's axis goes through the middle of the image, the rest is in the extras."""
    intrinsics = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy", "skew")}
    return {
        "name": "camera",
        "type": "perspective",
        "perspective": {
            "aspectRatio": camera.width * camera.fy / (camera.height * camera.fx),
            "yfov": 2 * float(np.arctan(camera.height / (2 * camera.fy))),
            "znear": 0.1,
        },
        "extras": {"intrinsics_px": intrinsics},
    }


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


def _coloured(thing: MapObject) -> trimesh.Trimesh:
    import trimesh

    colours = linear(vertex_colours(thing))
    return trimesh.Trimesh(thing.vertices, thing.faces, vertex_colors=colours, process=False)


def linear(colours: Bytes) -> Bytes:
    """Colours (n, 4) of sRGB as glTF's COLOR_0 has them: linear (IEC 61966-2-1), the opacity as it is."""
    share = colours[:, :3] / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.column_stack([np.round(255 * light), colours[:, 3]]).astype(np.uint8)


def _mark() -> trimesh.Trimesh:
    """Draw a 10 cm box: an empty scene is no valid glTF."""
    import trimesh

    mark: trimesh.Trimesh = trimesh.creation.box((0.1, 0.1, 0.1))
    return mark


def _tube(points: Floats) -> trimesh.Trimesh:
    """Draw a thin tube along points (n, 3); a single point becomes a ball."""
    import trimesh

    keep = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-3])
    points = points[keep]
    if len(points) < 2:
        ball = trimesh.creation.icosphere(subdivisions=2, radius=2 * PATH_RADIUS_M)
        vertices, faces = np.asarray(ball.vertices) + points[0], np.asarray(ball.faces)
    else:
        vertices, faces = _tube_parts(points)
    colours = linear(np.tile(PATH_COLOUR, (len(vertices), 1)))
    return trimesh.Trimesh(vertices, faces, vertex_colors=colours, process=False)


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
