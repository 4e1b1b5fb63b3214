"""Training pictures: a car in its surroundings as a car's camera sees it, its mask, and where its key points are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from meshslam.geometry import Bools, Bytes, Camera, Floats, Pose, Rendering, Singles, render
from meshslam.simulation import Light, ProceduralCar, draw_light, lit, look_of, shaded, surface
from meshslam.training.background import backdrop, ground_texture
from meshslam.training.layout import Layout, draw_layout

_FINE_BELOW_PX = 110  # smaller pictures are drawn with 2 x 2 samples a pixel
_NEAR_M = 2.2  # neighbours this near to the camera are left out
_SLACK_M = 0.12  # a key point lies this far under the surface at most


@dataclass(frozen=True, eq=False)
class Picture:
    """What a camera sees of one car."""

    image_bgr: Singles  # (h, w, 3), light: 1 is white in the sun, what mirrors may be brighter
    mask: Bools  # (h, w), the car's own pixels
    others: Bools  # (h, w), other cars' pixels
    whole_px: int  # pixels that the car would have without anything before it
    keypoints: Floats  # (12, 2), px
    visible: Bools  # (12,), ahead of the camera, inside the image and hidden by nothing
    viewing_angle_rad: float


def draw_picture(rng: np.random.Generator, cars: Sequence[ProceduralCar]) -> Picture:
    """Draw a scene and render it."""
    layout, light = draw_layout(rng, cars), draw_light(rng)
    kept = [layout.cars[0], *(c for c in layout.cars[1:] if _clear_of_camera(layout, c.world_from_car, c.car))]
    layout = replace(layout, cars=tuple(kept))
    fine = 2 if max(layout.camera.width, layout.camera.height) < _FINE_BELOW_PX * 1.9 else 1
    camera = _finer(layout.camera, fine)
    meshes = [(layout.camera_from_world @ c.world_from_car, c.car.vertices, c.car.faces) for c in layout.cars]
    drawn = render(camera, meshes)
    colour = _background(rng, camera, layout, light)
    rays = camera.rays(_pixels(camera))
    for i, placed in enumerate(layout.cars):
        here = drawn.object_index == i
        if here.any():
            colour[here] = _car_colours(rng, placed.car, meshes[i][0], layout, light, drawn, rays, here)
    size = (layout.camera.width, layout.camera.height)
    shrunk = [cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in _planes(colour, drawn)]
    alone = render(layout.camera, meshes[:1])
    points = meshes[0][0].transform(layout.cars[0].car.keypoints)
    pixels = layout.camera.project(np.where(points[:, 2:] > 0.2, points, [0, 0, 1.0]))
    return Picture(
        np.asarray(shrunk[0], np.float32),
        np.asarray(shrunk[1]) > 0.5,
        np.asarray(shrunk[2]) > 0.5,
        int((alone.object_index == 0).sum()),
        pixels,
        _visible(drawn, camera, points, fine),
        layout.viewing_angle_rad,
    )


def _clear_of_camera(layout: Layout, world_from_car: Pose, car: ProceduralCar) -> bool:
    points = (layout.camera_from_world @ world_from_car).transform(car.vertices[: car.coarse])
    return bool(np.linalg.norm(points, axis=1).min() > _NEAR_M)


def _planes(colour: Floats, drawn: Rendering) -> tuple[Floats, Floats, Floats]:
    return colour, (drawn.object_index == 0).astype(float), (drawn.object_index > 0).astype(float)


def _finer(camera: Camera, times: int) -> Camera:
    shift = (times - 1) / 2
    return Camera(
        times * camera.width,
        times * camera.height,
        times * camera.fx,
        times * camera.fy,
        times * camera.cx + shift,
        times * camera.cy + shift,
    )


def _pixels(camera: Camera) -> Floats:
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return np.stack([columns, rows], -1).astype(float)


def _car_colours(
    rng: np.random.Generator,
    car: ProceduralCar,
    camera_from_car: Pose,
    layout: Layout,
    light: Light,
    drawn: Rendering,
    rays: Floats,
    here: Bools,
) -> Floats:
    """Colours (n, 3) of a car's pixels."""
    in_camera = rays[here] / drawn.inverse_depth[here][:, None]
    points = camera_from_car.inverse().transform(in_camera)
    normals = car.face_normals[drawn.face_index[here]]
    made_of = surface(car.shape, look_of(rng, car.shape, car.kind), points, normals)
    world_from_camera = layout.camera_from_world.inverse()
    along = in_camera / np.linalg.norm(in_camera, axis=1, keepdims=True)
    normals_in_world = normals @ (world_from_camera.rotation @ camera_from_car.rotation).T
    return shaded(
        light, made_of.colour, made_of.mirror, along @ world_from_camera.rotation.T, normals_in_world, points[:, 2]
    )


def _background(rng: np.random.Generator, camera: Camera, layout: Layout, light: Light) -> Floats:
    """Road, its shadows, and what stands behind it."""
    colour = backdrop(rng, camera, light)
    pose = layout.camera_from_world.inverse()
    rays = camera.rays(_pixels(camera)) @ pose.rotation.T
    plane_z = float(np.mean([c.world_from_car.translation[2] for c in layout.cars[:1]]))
    down = rays[..., 2] < -0.02
    depth = (plane_z - pose.translation[2]) / np.where(down, rays[..., 2], -1.0)
    down &= (depth > 0) & (depth < rng.uniform(25, 120))
    points = pose.translation + rays[down] * depth[down][:, None]
    bright = ground_texture(rng, points[:, 0], points[:, 1], depth[down] / camera.fx)
    shadow = _shadows(camera, layout, light, plane_z)[down]
    full = lit(light, np.array([[0.0, 0.0, 1.0]]))[0]
    open_sky = light.ambient * light.tint
    light_there = open_sky + (full - open_sky) * (1 - shadow[:, :1])
    colour[down] = light.ground * bright[:, None] * light_there * (1 - 0.9 * shadow[:, 1:])
    return colour


def _shadows(camera: Camera, layout: Layout, light: Light, plane_z: float) -> Floats:
    """How much of the sun (first plane) and of the sky (second) the cars hide on the road: (h, w, 2)."""
    planes = np.zeros((2, camera.height, camera.width), np.float32)
    for placed in layout.cars:
        vertices = placed.world_from_car.transform(placed.car.vertices[: placed.car.coarse])
        up = vertices[:, 2:] - plane_z
        thrown = vertices - up * light.sun / max(light.sun[2], 0.05)
        low, high = placed.car.vertices.min(0) + [0.05, 0.12, 0], placed.car.vertices.max(0) - [0.05, 0.12, 0]
        corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
        foot = placed.world_from_car.transform(np.column_stack([corners, np.zeros(4)]))
        foot[:, 2] = plane_z
        _fill(planes[0], camera, layout.camera_from_world.transform(thrown))
        _fill(planes[1], camera, layout.camera_from_world.transform(foot))
    soft = max(1.0, 0.012 * camera.width)
    blurred = [cv2.GaussianBlur(p, (0, 0), s) for p, s in zip(planes, (0.4 * soft, 1.5 * soft), strict=True)]
    return np.stack(blurred, -1).astype(float)


def _fill(plane: np.ndarray, camera: Camera, points: Floats) -> None:
    """Fill the hull of points on the road; those behind the camera are left out."""
    ahead = points[points[:, 2] > 0.5]
    if len(ahead) < 3:
        return
    pixels = np.clip(camera.project(ahead), -4000, 4000).astype(np.int32)
    cv2.fillConvexPoly(plane, cv2.convexHull(pixels), 1.0)


def _visible(drawn: Rendering, camera: Camera, points: Floats, fine: int) -> Bools:
    """Which points (n, 3) in the camera are inside the picture and on the car's drawn surface."""
    ahead = points[:, 2] > 0.2
    pixels = camera.project(np.where(ahead[:, None], points, [0, 0, 1.0]))
    at = np.round(np.nan_to_num(pixels, nan=-1.0)).astype(int)
    inside = ahead & (at >= 0).all(1) & (at < [camera.width, camera.height]).all(1)
    x, y = np.clip(at, 0, [camera.width - 1, camera.height - 1]).T
    free = drawn.inverse_depth[y, x] < 1.0 / np.maximum(points[:, 2] - _SLACK_M, 0.1)
    reach = np.ones((2 * fine + 1, 2 * fine + 1), np.uint8)
    own = cv2.dilate((drawn.object_index == 0).astype(np.uint8), reach)[y, x] > 0
    shown: Bools = inside & free & own
    return shown


def as_bytes(colour: Singles) -> Bytes:
    """Colours from 0 to 1 as bytes."""
    return np.asarray(np.clip(np.round(colour * 255), 0, 255), np.uint8)
