"""Where the cars of a training scene stand, and the camera that looks at one of them.

World: z up, the road at z = 0 below the camera, which looks along x.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Camera, Floats, Pose
from meshslam.simulation import ProceduralCar

_CAMERA_FROM_LEVEL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
_ROOM = 0.45  # drawn around the car, in its size, on each side


@dataclass(frozen=True, eq=False)
class Placed:
    """A car at its place; the car's frame is that of ProceduralCar."""

    car: ProceduralCar
    world_from_car: Pose


@dataclass(frozen=True, eq=False)
class Layout:
    """The first of the cars is the one that is looked at."""

    camera: Camera  # of the drawn part of the image alone
    camera_from_world: Pose
    cars: tuple[Placed, ...]
    viewing_angle_rad: float  # of the camera seen from the car: 0 ahead of it, pi / 2 at its left


def draw_layout(rng: np.random.Generator, cars: Sequence[ProceduralCar]) -> Layout:
    """Draw a camera as cars carry it (1.2 to 2 m above the road), and 1 to 5 parked cars."""
    target = cars[int(rng.integers(len(cars)))]
    angle = _viewing_angle(rng)
    bearing = rng.uniform(-0.6, 0.6)
    distance_m = float(np.exp(rng.uniform(np.log(4.0), np.log(40.0))))
    yaw = np.pi + bearing - angle
    at = np.array([distance_m * np.cos(bearing), distance_m * np.sin(bearing), rng.normal(0, 0.01 * distance_m)])
    tilt = _rotation(rng.normal(0, 0.015), rng.normal(0, 0.02), 0.0)
    world_from_target = Pose(Pose.from_yaw(yaw, np.zeros(3)).rotation @ tilt, at)
    world_from_target = _about_middle(world_from_target, target)
    placed = [Placed(target, world_from_target), *_neighbours(rng, cars, target, world_from_target)]
    height_m = rng.uniform(1.2, 2.0)
    turn = _rotation(rng.normal(0, 0.02), rng.normal(0, 0.03), 0.0)
    eye = np.array([0.0, 0.0, height_m])
    rotation = _CAMERA_FROM_LEVEL @ turn
    camera_from_world = Pose(rotation, -rotation @ eye)
    camera = _camera(rng, camera_from_world, placed[0])
    seen_from = world_from_target.inverse().transform(eye) - target.middle
    return Layout(camera, camera_from_world, tuple(placed), float(np.arctan2(seen_from[1], seen_from[0])))


def _viewing_angle(rng: np.random.Generator) -> float:
    """Any angle; front and rear views, the most frequent in a street, more often."""
    if rng.random() < 0.5:
        return float(rng.uniform(-np.pi, np.pi))
    return float(rng.normal(np.pi * (rng.random() < 0.5), 0.6))


def _rotation(roll: float, pitch: float, yaw: float) -> Floats:
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1.0]])
    product: Floats = about_z @ about_y @ about_x
    return product


def _about_middle(pose: Pose, car: ProceduralCar) -> Pose:
    """The pose that brings the car's middle, not the middle of its wheelbase, to the place."""
    shift = pose.rotation @ (car.middle * [1, 1, 0])
    return Pose(pose.rotation, pose.translation - shift)


def _neighbours(
    rng: np.random.Generator, cars: Sequence[ProceduralCar], target: ProceduralCar, pose: Pose
) -> list[Placed]:
    """Cars ahead and behind in the row, or beside it, or across the road."""
    found: list[Placed] = []
    if rng.random() < 0.25:
        return found
    abreast = rng.random() < 0.25
    for side in (-1, 1):
        if rng.random() < 0.45:
            continue
        other = cars[int(rng.integers(len(cars)))]
        if abreast:
            away = np.array([rng.normal(0, 0.3), side * (1.9 + rng.uniform(0.5, 1.2)), 0.0])
        else:
            reach = (target.shape.length + other.shape.length) / 2
            away = np.array([side * (reach + rng.uniform(0.4, 2.5)), rng.normal(0, 0.15), 0.0])
        found.append(_beside(rng, pose, target, other, away, flip=rng.random() < 0.2))
    if rng.random() < 0.3:
        other = cars[int(rng.integers(len(cars)))]
        away = np.array([rng.uniform(-8, 8), rng.choice([-1, 1]) * rng.uniform(3.0, 12.0), 0.0])
        found.append(_beside(rng, pose, target, other, away, flip=rng.random() < 0.5))
    return found


def _beside(
    rng: np.random.Generator, pose: Pose, target: ProceduralCar, other: ProceduralCar, away: Floats, *, flip: bool
) -> Placed:
    turn = rng.normal(0, 0.05) + (np.pi if flip else 0.0)
    rotation = pose.rotation @ Pose.from_yaw(turn, np.zeros(3)).rotation
    at = pose.transform(target.middle * [1, 1, 0] + away)
    return Placed(other, _about_middle(Pose(rotation, at), other))


def _camera(rng: np.random.Generator, camera_from_world: Pose, target: Placed) -> Camera:
    """A camera whose image is the part around the target, which is 24 to 220 px wide or high in it."""
    points = (camera_from_world @ target.world_from_car).transform(target.car.vertices[: target.car.coarse])
    points[:, 2] = np.maximum(points[:, 2], 0.3)
    plane = points[:, :2] / points[:, 2:]
    low, high = plane.min(0), plane.max(0)
    size_px = float(np.exp(rng.uniform(np.log(24.0), np.log(220.0))))
    focal = size_px / float((high - low).max())
    room = _ROOM * (high - low).max() * np.array([1.0, 0.7])
    (x0, y0), (x1, y1) = focal * (low - room), focal * (high + room)
    return Camera(max(8, round(x1 - x0)), max(8, round(y1 - y0)), focal, focal, -x0, -y0)
