"""A street: parked cars on both sides, one that drives, house fronts, and a camera that drives along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Camera, Pose
from meshslam.geometry.arrays import Floats, Ints

_WORLD_FROM_FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # the camera looks along x


@dataclass(frozen=True)
class StreetConfig:
    """What a street is like: its road runs along x at z = 0, the camera's lane is the right one."""

    frames: int = 28
    frame_interval_s: float = 0.1
    speed_m_s: float = 10.0
    width_px: int = 800
    height_px: int = 240
    focal_px: float = 470.0
    camera_height_m: float = 1.65
    cars_each_side: int = 5
    first_car_m: float = 8.0  # of the nearest parked cars' rear bumpers
    kerb_m: float = 4.9  # half the street's width, parked cars included
    lane_m: float = 1.1  # half the distance of the two lanes' middles
    largest_z: float = 1.5  # of the cars' mode weights, in standard deviations
    moving_speed_m_s: float = 7.0
    moving_start_m: float = 15.0


@dataclass(frozen=True, eq=False)
class Car:
    """A car, parked or driving evenly; the origin of its frame is the centre of its bounding box."""

    id: int
    category: str
    start: Pose  # world_from_object at time 0
    velocity_in_world: Floats  # (3,), m/s
    vertices: Floats  # (V, 3)
    faces: Ints  # (F, 3)
    keypoints: dict[str, Floats]  # (3,), in object
    colour_bgr: Floats  # (3,), 0 to 1

    @property
    def moves(self) -> bool:
        """Whether it is on the way."""
        return bool(self.velocity_in_world.any())

    def at(self, time_s: float) -> Pose:
        """world_from_object at a time."""
        return Pose(self.start.rotation, self.start.translation + self.velocity_in_world * time_s)


@dataclass(frozen=True, eq=False)
class Wall:
    """A house front: an upright rectangle from `start` to `end` (2,), on the ground."""

    start: Floats
    end: Floats
    height_m: float
    colour_bgr: Floats  # (3,), 0 to 1

    @property
    def vertices(self) -> Floats:
        """Corners (4, 3), in world."""
        low = np.array([[*self.start, 0.0], [*self.end, 0.0]])
        return np.concatenate([low, low + [0.0, 0.0, self.height_m]])

    @property
    def faces(self) -> Ints:
        """Both triangles, seen from both sides alike."""
        return np.array([[0, 1, 2], [1, 3, 2]])

    @property
    def normal(self) -> Floats:
        """Unit normal (3,)."""
        along = np.append(self.end - self.start, 0.0) / np.linalg.norm(self.end - self.start)
        return np.cross(along, [0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Street:
    """Everything that there is, and who looks at it when."""

    seed: int
    camera: Camera
    times_s: Floats  # (n,)
    world_from_camera: tuple[Pose, ...]
    camera_height_m: float
    kerb_m: float
    cars: tuple[Car, ...]
    walls: tuple[Wall, ...]


def make_street(category: Category, seed: int = 0, config: StreetConfig | None = None) -> Street:
    """Draw a street: the same seed gives the same street."""
    config = config or StreetConfig()
    rng = np.random.default_rng(seed)
    times_s: Floats = np.arange(config.frames) * np.float64(config.frame_interval_s)
    camera = Camera(
        config.width_px,
        config.height_px,
        config.focal_px,
        config.focal_px,
        (config.width_px - 1) / 2,
        0.42 * config.height_px,
    )
    cars: list[Car] = []
    for side in (-1.0, 1.0):
        along = config.first_car_m + rng.uniform(0.0, 3.0)
        for _ in range(config.cars_each_side):
            car = _parked_car(len(cars) + 1, side, along, category, rng, config)
            cars.append(car)
            along += float(np.ptp(car.vertices[:, 0])) + rng.uniform(0.8, 3.0)
    cars.append(_moving_car(len(cars) + 1, category, rng, config))
    return Street(
        seed,
        camera,
        times_s,
        tuple(_camera_at(t, config) for t in times_s),
        config.camera_height_m,
        config.kerb_m,
        tuple(cars),
        _walls(rng, config),
    )


def _camera_at(time_s: float, config: StreetConfig) -> Pose:
    """The camera swings gently within its lane, and nods."""
    x = config.speed_m_s * time_s
    y = -config.lane_m + 0.25 * np.sin(0.15 * x)
    yaw, pitch = np.arctan(0.25 * 0.15 * np.cos(0.15 * x)), 0.004 * np.sin(0.9 * x)
    turn = Pose.from_yaw(float(yaw), np.array([x, y, config.camera_height_m]))
    c, s = np.cos(pitch), np.sin(pitch)
    nod = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return Pose(turn.rotation @ nod @ _WORLD_FROM_FORWARD, turn.translation)


def _parked_car(
    number: int, side: float, rear_m: float, category: Category, rng: np.random.Generator, config: StreetConfig
) -> Car:
    """A car at the right (-1) or left (+1) kerb; those at the left mostly face the camera."""
    vertices = _shape(category, rng, config)
    length, width, height = np.ptp(vertices, axis=0)
    faces_camera = rng.random() < (0.8 if side > 0 else 0.1)
    y = side * (config.kerb_m - 0.2 - width / 2)
    yaw = (np.pi if faces_camera else 0.0) + rng.normal(0.0, 0.03)
    pose = Pose.from_yaw(float(yaw), np.array([rear_m + length / 2, y, height / 2]))
    return _car(number, pose, np.zeros(3), vertices, category, rng)


def _moving_car(number: int, category: Category, rng: np.random.Generator, config: StreetConfig) -> Car:
    """A car ahead in the camera's lane."""
    vertices = _shape(category, rng, config)
    height = float(np.ptp(vertices[:, 2]))
    pose = Pose.from_yaw(0.0, np.array([config.moving_start_m, -config.lane_m, height / 2]))
    return _car(number, pose, np.array([config.moving_speed_m_s, 0.0, 0.0]), vertices, category, rng)


def _shape(category: Category, rng: np.random.Generator, config: StreetConfig) -> Floats:
    """A shape of the category, its bounding box centred."""
    z = np.clip(rng.normal(size=len(category.modes)), -config.largest_z, config.largest_z)
    vertices = category.shape(z)
    centred: Floats = vertices - (vertices.max(0) + vertices.min(0)) / 2
    return centred


_PAINTS_BGR = np.array(
    [
        [0.75, 0.76, 0.77],  # silver
        [0.88, 0.88, 0.87],  # white
        [0.20, 0.20, 0.21],  # anthracite
        [0.50, 0.26, 0.12],  # blue
        [0.14, 0.12, 0.55],  # red
        [0.28, 0.38, 0.22],  # green
        [0.30, 0.62, 0.75],  # sand
    ]
)


def _car(
    number: int, start: Pose, velocity: Floats, vertices: Floats, category: Category, rng: np.random.Generator
) -> Car:
    paint = _PAINTS_BGR[rng.integers(len(_PAINTS_BGR))] * rng.uniform(0.9, 1.1)
    keypoints = dict(zip(category.keypoint_names, category.keypoints(vertices), strict=True))
    return Car(number, category.name, start, velocity, vertices, category.faces, keypoints, np.clip(paint, 0.0, 1.0))


def _walls(rng: np.random.Generator, config: StreetConfig) -> tuple[Wall, ...]:
    """House fronts along both pavements, and one that closes the street."""
    walls: list[Wall] = []
    for side in (-1.0, 1.0):
        x = -12.0
        while x < 110.0:
            width, back = rng.uniform(8.0, 16.0), side * (config.kerb_m + 3.0)
            colour = np.array([0.55, 0.62, 0.68]) * rng.uniform(0.85, 1.15, 3)
            ends = np.array([x, back]), np.array([x + width, back])
            walls.append(Wall(*ends, rng.uniform(6.0, 13.0), np.clip(colour, 0.0, 1.0)))
            x += width
    walls.append(Wall(np.array([112.0, -25.0]), np.array([112.0, 25.0]), 9.0, np.array([0.5, 0.56, 0.6])))
    return tuple(walls)
