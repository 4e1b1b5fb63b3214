"""Frames of a street: an image as a camera takes it, and what exactly is in each pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from meshslam.geometry import Camera, Rendering, render
from meshslam.geometry.arrays import Bools, Bytes, Floats, Ints
from meshslam.simulation import paint
from meshslam.simulation.street import Car, Street, Wall

_FINER = 2  # samples a pixel and axis
_HAZE_BGR = np.array([0.9, 0.88, 0.85])
_UP = np.array([0.0, 0.0, 1.0])


def draw(street: Street, index: int, camera: Camera | None = None) -> Rendering:
    """What is nearest in each pixel of frame `index`: `object_index` counts the cars, then the walls."""
    camera_from_world = street.world_from_camera[index].inverse()
    time_s = float(street.times_s[index])
    meshes = [(camera_from_world @ car.at(time_s), car.vertices, car.faces) for car in street.cars]
    meshes += [(camera_from_world, wall.vertices, wall.faces) for wall in street.walls]
    return render(camera or street.camera, meshes)


def render_image(street: Street, index: int) -> Bytes:
    """Frame `index` as BGR (h, w, 3): sun, shadows, textures; several samples a pixel."""
    scene = _Scene.of(street, index)
    colour = paint.sky(scene.rays_in_world)
    noise = paint.Noise(street.seed)
    colour[scene.on_ground] = _ground_colours(scene, street, noise)
    for i, wall in enumerate(street.walls):
        here = scene.drawn.object_index == len(street.cars) + i
        if here.any():
            plain = paint.wall(wall, scene.points_in_world[here], scene.pixel_m[here], noise)
            colour[here] = paint.shaded(plain, np.broadcast_to(_facing(wall, scene.eye), plain.shape))
    for i, car in enumerate(street.cars):
        here = scene.drawn.object_index == i
        if here.any():
            colour[here] = _car_colours(car, scene, here)
    small = cv2.resize(colour, (street.camera.width, street.camera.height), interpolation=cv2.INTER_AREA)
    return np.clip(np.round(small * 255.0), 0, 255).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class _Scene:
    """A frame at the fine resolution (h, w)."""

    time_s: float
    eye: Floats  # (3,), in world
    drawn: Rendering
    rays_in_world: Floats  # (h, w, 3), 1 m deep
    points_in_world: Floats  # (h, w, 3); on the ground where nothing is drawn and the ray goes down
    on_ground: Bools  # (h, w)
    pixel_m: Floats  # (h, w), size of a pixel's side at the point, across the ray

    @staticmethod
    def of(street: Street, index: int) -> _Scene:
        camera, pose = _finer(street.camera), street.world_from_camera[index]
        drawn = draw(street, index, camera)
        columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        rays = camera.rays(np.stack([columns, rows], axis=-1).astype(float)) @ pose.rotation.T
        down = rays[..., 2] < -1e-4
        ground_depth_m = np.where(down, -pose.translation[2] / np.where(down, rays[..., 2], -1.0), 0.0)
        empty = drawn.inverse_depth <= 0
        depth_m = np.where(empty, ground_depth_m, 1.0 / np.where(empty, 1.0, drawn.inverse_depth))
        points = pose.translation + rays * depth_m[..., None]
        pixel_m = np.maximum(depth_m / camera.fx, 1e-4)
        return _Scene(
            float(street.times_s[index]), pose.translation, drawn, rays, points, empty & (ground_depth_m > 0), pixel_m
        )


def _finer(camera: Camera) -> Camera:
    """The same camera with `_FINER` times as many pixels an axis."""
    shift = (_FINER - 1) / 2
    return replace(
        camera,
        width=_FINER * camera.width,
        height=_FINER * camera.height,
        fx=_FINER * camera.fx,
        fy=_FINER * camera.fy,
        cx=_FINER * camera.cx + shift,
        cy=_FINER * camera.cy + shift,
        skew=_FINER * camera.skew,
    )


def _facing(wall: Wall, eye: Floats) -> Floats:
    """The wall's normal (3,) on the side that is seen."""
    side: Floats = wall.normal * np.sign(wall.normal @ (eye - wall.vertices[0]))
    return side


def _ground_colours(scene: _Scene, street: Street, noise: paint.Noise) -> Floats:
    """Colours (n, 3) of the ground's pixels, paler in the distance; pixels are stretched along the line of sight."""
    points = scene.points_in_world[scene.on_ground]
    away = np.linalg.norm(points - scene.eye, axis=-1)
    stretched = scene.pixel_m[scene.on_ground] * np.sqrt(np.maximum(away / max(scene.eye[2], 0.1), 1.0))
    plain = paint.ground(points, street.kerb_m, stretched, noise)
    lit = ~_in_shadow(points[:, :2], street, scene.time_s)
    lighted = paint.shaded(plain, np.broadcast_to(_UP, plain.shape), lit)
    haze = np.clip((away - 40.0) / 120.0, 0.0, 0.7)[:, None]
    pale: Floats = lighted + (_HAZE_BGR - lighted) * haze
    return pale


def _in_shadow(points: Floats, street: Street, time_s: float) -> Bools:
    """Where on the ground (n, 2) a car hides the sun: in the hull of its vertices, thrown along the sun's rays."""
    dark = np.zeros(len(points), bool)
    for car in street.cars:
        vertices = car.at(time_s).transform(car.vertices)
        thrown = (vertices - vertices[:, 2:] * paint.SUN / paint.SUN[2])[:, :2]
        hull = cv2.convexHull(thrown.astype(np.float32))[:, 0].astype(float)
        near = ((points > hull.min(0)) & (points < hull.max(0))).all(1)
        edges = np.roll(hull, -1, axis=0) - hull
        gaps = points[near][:, None] - hull[None]
        turns = edges[:, 0] * gaps[..., 1] - edges[:, 1] * gaps[..., 0]
        dark[near] |= (turns > 0).all(1) | (turns < 0).all(1)
    return dark


def _car_colours(car: Car, scene: _Scene, here: Bools) -> Floats:
    """Colours (n, 3) of a car's pixels; glass and paint mirror a little of the sky."""
    world_from_object = car.at(scene.time_s)
    points = world_from_object.inverse().transform(scene.points_in_world[here])
    normals = _smooth_normals(car.vertices, car.faces, scene.drawn.face_index[here].astype(np.int64), points)
    in_world = normals @ world_from_object.rotation.T
    lighted = paint.shaded(paint.car(car, points, normals), in_world)
    rays = scene.rays_in_world[here]
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    along = (rays * in_world).sum(1)[:, None]
    mirrored = rays - 2 * along * in_world
    share = 0.06 + 0.5 * (1.0 - np.abs(along)) ** 4
    seen = np.where(mirrored[:, 2:] > 0.0, paint.sky(mirrored), 0.35)
    mixed: Floats = lighted + (seen - lighted) * share
    return mixed


def _smooth_normals(vertices: Floats, faces: Ints, face_index: Ints, points: Floats) -> Floats:
    """Unit normals (n, 3) at points on faces, interpolated between those of the corners (Phong 1975)."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
    of_vertex = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(of_vertex, faces[:, i], across)
    corners = faces[face_index]
    twice = across[face_index]
    area = np.maximum((twice * twice).sum(1), 1e-18)
    w_b = (np.cross(points - a[face_index], (c - a)[face_index]) * twice).sum(1) / area
    w_c = (np.cross((b - a)[face_index], points - a[face_index]) * twice).sum(1) / area
    weights = np.clip(np.stack([1.0 - w_b - w_c, w_b, w_c], axis=1), 0.0, 1.0)
    unit = of_vertex / np.maximum(np.linalg.norm(of_vertex, axis=1, keepdims=True), 1e-12)
    mixed = (weights[:, :, None] * unit[corners]).sum(1)
    normals: Floats = mixed / np.maximum(np.linalg.norm(mixed, axis=1, keepdims=True), 1e-12)
    return normals


def visible(drawn: Rendering, object_index: int, pixels: Floats, depths_m: Floats, slack_m: float = 0.2) -> Bools:
    """Which points (n, 2) of an object, at depths (n,), no nearer surface hides, and which lie in the image."""
    height, width = drawn.object_index.shape
    inside = (depths_m > 0.1) & np.isfinite(pixels).all(1)
    at = np.round(np.where(inside[:, None], pixels, -1.0)).astype(int)
    inside &= (at >= 0).all(1) & (at < [width, height]).all(1)
    x, y = np.clip(at, 0, [width - 1, height - 1]).T
    free = drawn.inverse_depth[y, x] < 1.0 / np.maximum(depths_m - slack_m, 0.1)
    own = _near(drawn.object_index == object_index)[y, x]
    shown: Bools = inside & free & own
    return shown


def _near(mask: Bools) -> Bytes:
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)
