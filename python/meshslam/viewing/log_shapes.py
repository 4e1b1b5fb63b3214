"""What logs of a run draw: colours, outlines in images, ellipsoids of covariances, and which objects changed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np

from meshslam.geometry import Bytes, Camera, Floats, Pose, quaternions_of_rotations, render
from meshslam.maps import MapObject, object_colour
from meshslam.perception import Detection
from meshslam.viewing.overlay import UNMAPPED_RGB, mask_contours
from meshslam.viewing.run_log import Colouring

LOW_SIGMA_M, HIGH_SIGMA_M = 0.01, 0.3  # ends of the scale of colours, which is logarithmic
ELLIPSOID_SIGMAS = 3.0
MIN_HALF_SIZE_M = 1e-4  # an ellipsoid without extent is not drawn by viewers
MIN_OUTLINE_PX = 4.0  # radius of an object that is outlined: along a straight street all cars ahead are in view
CHANGED_M = 0.005  # an object is told again when a vertex of it moved so far


def vertex_colours(thing: MapObject, colouring: Colouring) -> Bytes:
    """Colours (V, 3) of an object's vertices, RGB.

    By `id` all are of the object's own colour. By `sigma` they go from violet at 1 cm over green to yellow at 30 cm;
    where the vertices' own are not known, the sigma of the object's position is taken; grey where that is not either.
    """
    if colouring == "id":
        return np.tile(object_colour(thing.id), (len(thing.vertices), 1))
    sigma_m = thing.vertex_sigma_m
    if sigma_m is None and thing.pose_covariance is not None:
        sigma_m = np.full(len(thing.vertices), np.sqrt(max(0.0, np.trace(thing.pose_covariance[:3, :3]))))
    if sigma_m is None:
        return np.tile(np.array(UNMAPPED_RGB, np.uint8), (len(thing.vertices), 1))
    share = np.log(np.maximum(sigma_m, 1e-9) / LOW_SIGMA_M) / np.log(HIGH_SIGMA_M / LOW_SIGMA_M)
    levels = np.round(255 * np.clip(share, 0, 1)).astype(np.uint8)
    bgr = cv2.applyColorMap(levels[:, None], cv2.COLORMAP_VIRIDIS)[:, 0]
    return np.ascontiguousarray(bgr[:, ::-1], np.uint8)


def detection_colour(detection: Detection) -> Bytes:
    """Colour (3,) of a detection, RGB: that of its track, grey without one."""
    return np.array(UNMAPPED_RGB, np.uint8) if detection.track_id is None else object_colour(detection.track_id)


def mesh_outlines(camera: Camera, world_from_camera: Pose, objects: Sequence[MapObject]) -> dict[int, list[Floats]]:
    """Borders (n, 2) of what is visible of each object, px, by its id; objects that hide one another are told apart."""
    camera_from_world = world_from_camera.inverse()
    things = _before(camera, camera_from_world, tuple(objects))
    meshes = [(camera_from_world @ thing.world_from_object, thing.vertices, thing.faces) for thing in things]
    index = render(camera, meshes).object_index
    shown = np.unique(index[index >= 0]).tolist()
    found = {things[i].id: mask_contours((index == i).astype(np.uint8)) for i in shown}
    return {number: borders for number, borders in found.items() if borders}


def _before(camera: Camera, camera_from_world: Pose, objects: tuple[MapObject, ...]) -> list[MapObject]:
    """The objects that may be in view and large enough: of a long drive's map they are few."""
    centres, radii = _balls(objects)
    x, y, z = camera_from_world.transform(centres).T
    wide = (max(camera.cx, camera.width - camera.cx) + 1 + abs(camera.skew) * camera.height) / camera.fx
    high = (max(camera.cy, camera.height - camera.cy) + 1) / camera.fy
    deepest = z + radii
    inside = (np.abs(x) - radii <= wide * deepest) & (np.abs(y) - radii <= high * deepest) & (deepest > 0)
    inside &= radii * camera.fx >= MIN_OUTLINE_PX * deepest
    return [objects[i] for i in np.flatnonzero(inside).tolist()]


@lru_cache(maxsize=1)
def _balls(objects: tuple[MapObject, ...]) -> tuple[Floats, Floats]:
    """Centres (n, 3) in the world and radii (n,) of balls around meshes."""
    centres = np.array([thing.world_from_object.translation for thing in objects]).reshape(-1, 3)
    return centres, np.array([np.linalg.norm(thing.vertices, axis=1).max() for thing in objects])


@dataclass(frozen=True, eq=False)
class Ellipsoids:
    """Where cameras may be, each at its estimate."""

    centres: Floats  # (n, 3), in world
    half_sizes_m: Floats  # (n, 3)
    quaternions_xyzw: Floats  # (n, 4), world_from_ellipsoid


def position_ellipsoids(world_from_camera: Sequence[Pose], covariances: Floats) -> Ellipsoids:
    """The ellipsoids of three sigmas of the cameras' positions; covariances (n, 6, 6) are of right perturbations."""
    rotations = np.array([pose.rotation for pose in world_from_camera]).reshape(-1, 3, 3)
    blocks = rotations @ np.asarray(covariances)[:, :3, :3] @ rotations.transpose(0, 2, 1)
    variances, axes = np.linalg.eigh((blocks + blocks.transpose(0, 2, 1)) / 2)
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]  # right-handed
    half_sizes = ELLIPSOID_SIGMAS * np.sqrt(np.maximum(variances, 0.0))
    centres = np.array([pose.translation for pose in world_from_camera]).reshape(-1, 3)
    return Ellipsoids(centres, np.maximum(half_sizes, MIN_HALF_SIZE_M), quaternions_of_rotations(axes))


@dataclass
class KnownObjects:
    """The objects that were told last: of the next ones, which are new or changed, and which are gone."""

    told: dict[int, MapObject] = field(default_factory=dict)
    current: tuple[MapObject, ...] = ()

    def changed(self, objects: Sequence[MapObject]) -> Iterator[tuple[MapObject, bool]]:
        """Objects to be told anew, and whether their mesh is another too; they then count as told."""
        self.current = tuple(objects)
        for thing in objects:
            last = self.told.get(thing.id)
            has_other_mesh = last is None or _differ(last.vertices, thing.vertices)
            if last is None or has_other_mesh or _differ(last.vertices_in_world, thing.vertices_in_world):
                self.told[thing.id] = thing
                yield thing, has_other_mesh

    def gone(self) -> list[MapObject]:
        """Objects that were told and are not there any more; they then count as not told."""
        left = {thing.id for thing in self.current}
        return [self.told.pop(number) for number in sorted(self.told.keys() - left)]


def _differ(one: Floats, other: Floats) -> bool:
    return one.shape != other.shape or float(np.abs(one - other).max()) > CHANGED_M
