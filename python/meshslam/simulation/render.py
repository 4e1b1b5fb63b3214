"""Frames of a street: an image as a camera takes it, and what exactly is in each pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from meshslam.geometry import Bools, Bytes, Camera, Floats, Ints, Pose, Rendering, render
from meshslam.perception import body_colour_bgr, point_colour_bgr
from meshslam.simulation import paint
from meshslam.simulation.bodies import Body
from meshslam.simulation.fronts import Wall
from meshslam.simulation.lens import image_through, render_through
from meshslam.simulation.light import Light, shaded, surroundings
from meshslam.simulation.shadow import Shadows
from meshslam.simulation.street import Street

_FINER = 2  # samples a pixel and axis
_SHADOW_AHEAD_M, _SHADOW_REACH_M = 22.0, 35.0
_HAZE_FROM_M, _HAZE_OVER_M, _HAZE_MOST = 40.0, 120.0, 0.7
_EXPOSURE, _GAMMA = 1.0, 0.7
_GREY = 0.42  # of everything that has no texture
_POINT_RADIUS_M = 0.07  # of the marks of key points
_CODE_SHADE = 0.6  # brightness of coded colours in the shadow, against 1 in the sun

Mesh = tuple[Pose, Floats, Ints]  # world_from_object, vertices, faces


def draw(street: Street, index: int, camera: Camera | None = None, world_from_camera: Pose | None = None) -> Rendering:
    """What is nearest in each pixel of frame `index`: `object_index` counts cars, then walls, then the ground.

    Another pinhole camera may be given, and its pose; else the frame is drawn as the street's lens sees it.
    """
    camera_from_world = (world_from_camera or street.world_from_camera[index]).inverse()
    meshes = [*_meshes(street, index), (Pose.identity(), *street.road.ground)]
    placed = [(camera_from_world @ pose, v, f) for pose, v, f in meshes]
    return render(camera, placed) if camera else render_through(street.distortion, street.camera, placed)


def _meshes(street: Street, index: int) -> list[Mesh]:
    time_s = float(street.times_s[index])
    cars = [(car.at(time_s), car.vertices, car.faces) for car in street.cars]
    return cars + [(Pose.identity(), wall.vertices, wall.faces) for wall in street.walls]


def street_light(seed: int) -> Light:
    """A sunny day."""
    rng = np.random.default_rng([seed, 2])
    height, turn = np.radians(rng.uniform(35.0, 60.0)), rng.uniform(0.0, 2 * np.pi)
    return Light(
        sun=np.array([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)]),
        sun_strength=1.0,
        ambient=0.7,
        tint=np.array([0.97, 1.0, 1.03]),
        sky_low=np.array([1.0, 0.98, 0.95]),
        sky_high=np.array([0.92, 0.70, 0.50]),
        horizon=np.array([0.30, 0.31, 0.32]),
        ground=np.full(3, 0.22),
        waves=rng.uniform(0.0, 2 * np.pi, 6),
        skyline=0.06,
    )


def render_image(street: Street, index: int) -> Bytes:
    """Frame `index` as BGR (h, w, 3): sun, shadows, textures, several samples a pixel; coded colours in one sample."""
    coded, pose, lens = street.mode == "contrast", street.world_from_camera[index], street.distortion
    finer = 1 if coded else _FINER
    ahead = pose.translation + _SHADOW_AHEAD_M * pose.rotation[:, 2]
    shadows = Shadows.of(_meshes(street, index), street_light(street.seed).sun, ahead, _SHADOW_REACH_M)

    def side(camera: Camera, camera_from_side: Pose) -> Floats:
        return _colours(_Scene.of(street, index, camera, pose @ camera_from_side), shadows, coded=coded)

    if lens is None:
        colour = _colours(_Scene.of(street, index, _finer(street.camera, finer), pose), shadows, coded=coded)
    else:
        colour = image_through(lens, finer, side, is_smooth=not coded)
    if coded:
        return _as_bytes(colour)
    size = (street.camera.width, street.camera.height)
    return _as_bytes(np.asarray(cv2.resize(colour, size, interpolation=cv2.INTER_AREA), float))


def _colours(scene: _Scene, shadows: Shadows, *, coded: bool) -> Floats:
    """Colours (h, w, 3) of a view, 0 to 1."""
    street = scene.street
    colour = np.zeros((*scene.drawn.object_index.shape, 3))
    painters = [_car(scene, k) for k in range(len(street.cars))] + [_wall(scene, k) for k in range(len(street.walls))]
    for paint_part in [*painters, _ground(scene)]:
        if paint_part is not None:
            here, part = paint_part
            colour[here] = part.coded(scene, shadows) if coded else part.lighted(scene, shadows)
    empty = scene.drawn.object_index < 0
    colour[empty] = 1.0 if coded else _sky(scene, empty)
    exposed: Floats = colour if coded else np.clip(_EXPOSURE * colour, 0.0, 1.0) ** _GAMMA
    return exposed


@dataclass(frozen=True, eq=False)
class _Scene:
    """A view of a frame at the fine resolution (h, w)."""

    street: Street
    pose: Pose
    time_s: float
    light: Light
    noise: paint.Noise
    drawn: Rendering
    rays_in_world: Floats  # (h, w, 3), 1 m deep
    pixel_m: Floats  # (h, w), size of a pixel's side at the point, across the ray

    @staticmethod
    def of(street: Street, index: int, camera: Camera, pose: Pose) -> _Scene:
        drawn = draw(street, index, camera, pose)
        columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        rays = camera.rays(np.stack([columns, rows], axis=-1).astype(float)) @ pose.rotation.T
        pixel_m = 1.0 / np.maximum(drawn.inverse_depth, 1e-4) / camera.fx
        time_s = float(street.times_s[index])
        return _Scene(street, pose, time_s, street_light(street.seed), paint.Noise(street.seed), drawn, rays, pixel_m)

    def points(self, here: Bools) -> Floats:
        """Points (n, 3) in world of the pixels that are drawn."""
        return self.pose.translation + self.rays_in_world[here] / self.drawn.inverse_depth[here][:, None]


@dataclass(frozen=True, eq=False)
class _Part:
    """Pixels of one thing: places, normals (n, 3) in world, colours, shares of mirrored light, height over ground."""

    points: Floats
    normals: Floats
    colour: Floats
    mirror: Floats
    height_m: Floats
    code: Floats | None = None  # (n, 3), colours that say what it is; None: grey

    def lighted(self, scene: _Scene, shadows: Shadows) -> Floats:
        """Colours (n, 3) under sun and sky, paler in the distance."""
        away = self.points - scene.pose.translation
        distance = np.linalg.norm(away, axis=1)
        lit = shadows.lit(self.points, self.normals)
        rays = away / distance[:, None]
        colour = shaded(scene.light, self.colour, self.mirror, rays, self.normals, self.height_m, lit)
        haze = np.clip((distance - _HAZE_FROM_M) / _HAZE_OVER_M, 0.0, _HAZE_MOST)[:, None]
        pale: Floats = colour + (scene.light.sky_low - colour) * haze
        return pale

    def coded(self, scene: _Scene, shadows: Shadows) -> Floats:
        """Colours (n, 3) that say what it is, darker where the sun does not shine."""
        facing = np.maximum(self.normals @ scene.light.sun, 0.0) * shadows.lit(self.points, self.normals)
        light = _CODE_SHADE + (1.0 - _CODE_SHADE) * facing
        plain = np.full((len(self.points), 3), _GREY) if self.code is None else self.code
        lighted: Floats = plain * light[:, None]
        return lighted


def _car(scene: _Scene, number: int) -> tuple[Bools, _Part] | None:
    here = scene.drawn.object_index == number
    if not here.any():
        return None
    car, in_world = scene.street.cars[number], scene.points(here)
    world_from_object = car.at(scene.time_s)
    points = world_from_object.inverse().transform(in_world)
    normals = smooth_normals(car.body, scene.drawn.face_index[here].astype(np.int64), points)
    low = float(car.vertices[:, 2].min())
    turned = normals @ world_from_object.rotation.T
    if scene.street.mode == "contrast":
        code = _code(car.body, car.id - 1, points)
        return here, _Part(in_world, turned, code, np.zeros(len(points)), points[:, 2] - low, code)
    if scene.street.mode == "textureless":
        plain = np.tile(car.skin.paint_bgr, (len(points), 1))
        return here, _Part(in_world, turned, plain, np.zeros(len(points)), points[:, 2] - low)
    return here, _Part(in_world, turned, *car.skin.at(points, normals), points[:, 2] - low)


def _code(body: Body, number: int, points: Floats) -> Floats:
    """Coded colours (n, 3) of points on a body: discs about its key points, the body's own elsewhere."""
    code = np.tile(body_colour_bgr(number), (len(points), 1))
    for index, place in enumerate(body.keypoints.values()):
        under = float(np.linalg.norm(body.vertices - place, axis=1).min())  # a key point may lie below the surface
        code[np.linalg.norm(points - place, axis=1) < np.hypot(under, _POINT_RADIUS_M)] = point_colour_bgr(index)
    return code


def _wall(scene: _Scene, number: int) -> tuple[Bools, _Part] | None:
    wall = scene.street.walls[number]
    here = scene.drawn.object_index == len(scene.street.cars) + number
    if not here.any():
        return None
    points = scene.points(here)
    plain = np.full((len(points), 3), _GREY)
    if scene.street.mode == "coloured":
        plain = paint.wall(wall, points, scene.pixel_m[here], scene.noise)
    normals = np.broadcast_to(_facing(wall, scene.pose.translation), points.shape)
    return here, _Part(points, normals, plain, np.zeros(len(points)), points[:, 2] - wall.start[2])


def _ground(scene: _Scene) -> tuple[Bools, _Part] | None:
    street = scene.street
    here = scene.drawn.object_index == len(street.cars) + len(street.walls)
    if not here.any():
        return None
    points = scene.points(here)
    plain = np.full((len(points), 3), _GREY)
    if street.mode == "coloured":
        away = np.linalg.norm(points - scene.pose.translation, axis=1)
        stretched = scene.pixel_m[here] * np.sqrt(np.maximum(away / street.camera_height_m, 1.0))  # along the sight
        plain = paint.ground(*street.road.coordinates(points), street.kerb_m, stretched, scene.noise)
    up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    return here, _Part(points, up, plain, np.zeros(len(points)), np.ones(len(points)))


def _sky(scene: _Scene, here: Bools) -> Floats:
    rays = scene.rays_in_world[here]
    return surroundings(scene.light, rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _finer(camera: Camera, times: int) -> Camera:
    """The same camera with `times` as many pixels an axis."""
    shift = (times - 1) / 2
    return replace(
        camera,
        width=times * camera.width,
        height=times * camera.height,
        fx=times * camera.fx,
        fy=times * camera.fy,
        cx=times * camera.cx + shift,
        cy=times * camera.cy + shift,
        skew=times * camera.skew,
    )


def _facing(wall: Wall, eye: Floats) -> Floats:
    """The wall's normal (3,) on the side that is seen."""
    side: Floats = wall.normal * np.sign(wall.normal @ (eye - wall.vertices[0]))
    return side


def smooth_normals(body: Body, face_index: Ints, points: Floats) -> Floats:
    """Unit normals (n, 3) at points on faces, interpolated between those of the corners (Phong 1975)."""
    corners = body.faces[face_index]
    a, b, c = (body.vertices[corners[:, i]] for i in range(3))
    twice = np.cross(b - a, c - a)
    area = np.maximum((twice * twice).sum(1), 1e-18)
    w_b = (np.cross(points - a, c - a) * twice).sum(1) / area
    w_c = (np.cross(b - a, points - a) * twice).sum(1) / area
    weights = np.clip(np.stack([1.0 - w_b - w_c, w_b, w_c], axis=1), 0.0, 1.0)
    mixed = (weights[:, :, None] * body.vertex_normals[corners]).sum(1)
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


def _as_bytes(colour: Floats) -> Bytes:
    return np.clip(np.round(colour * 255.0), 0, 255).astype(np.uint8)
