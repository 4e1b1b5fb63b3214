"""A street: parked cars on both sides, some that drive, house fronts, and a camera that drives along."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Camera, Floats, Ints, Pose
from meshslam.sequences import Distortion, undistorted
from meshslam.settings import Settings, setting
from meshslam.simulation.bodies import Body, BodySource, Skin, shapes_of
from meshslam.simulation.fronts import Wall, walls_along
from meshslam.simulation.motion import ImuReadings
from meshslam.simulation.road import Road
from meshslam.simulation.turning import crosses, near, turning_line

FORWARD_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # z ahead becomes x ahead
Mode = Literal["coloured", "textureless", "contrast"]
LensKind = Literal["pinhole", "equidistant"]
_LEAST_AHEAD_M = 6.5  # of the middle of a car that drives in front of the camera
_REAR_AXLE_SHARE = 0.3  # of a car's length, between its middle and its rear axle
_INSTANT_S = 0.05  # half the time over which a velocity is taken
_BEYOND_M = 10.0  # the last of cars that are spread begins so far after the drive's end


@dataclass(frozen=True)
class StreetConfig(Settings):
    """What a street is like: the camera's lane is the right one."""

    frames: int = setting(28, low=1)
    frame_interval_s: float = setting(0.1, above=0)
    speed_m_s: float = setting(10.0, low=0)
    bend_deg: float = setting(0.0, low=-180, high=180)  # how far the road turns to a side and back
    bend_length_m: float = setting(120.0, above=0)
    width_px: int = setting(800, low=1)
    height_px: int = setting(240, low=1)
    focal_px: float = setting(470.0, above=0)
    lens: LensKind = setting("pinhole")  # equidistant: a fisheye of `field_deg`, without distortion beyond that
    field_deg: float = setting(150.0, low=30, high=220)  # that a fisheye sees across; focal_px is the pinhole's
    camera_height_m: float = setting(1.65, above=0)
    cars_each_side: int = setting(5, low=0)
    first_car_m: float = setting(8.0)  # of the nearest parked cars' rear bumpers, from the first camera
    min_gap_m: float = setting(0.8, low=0)  # between parked cars
    max_gap_m: float = setting(3.0, low="min_gap_m")
    spread: bool = setting(False)  # cars stand evenly along the whole drive instead, left and right by turns
    kerb_m: float = setting(4.9, above=0)  # half the street's width, parked cars included
    sway_m: float = setting(0.25)  # of the camera in its lane
    lane_m: float = setting(1.1, low=0)  # half the distance of the two lanes' middles
    max_z: float = setting(1.5, low=0)  # of the mode weights of cars from a shape space, in standard deviations
    moving_cars: int = setting(1, low=0)  # ahead in the lane, then oncoming, by turns
    moving_speed_m_s: float = setting(7.0, low=0)
    moving_start_m: float = setting(15.0)  # of the first; oncoming ones come from `oncoming_start_m`
    oncoming_start_m: float = setting(45.0)
    turning_cars: int = setting(0, low=0)  # come towards the camera and turn off to their right
    turning_speed_m_s: float = setting(4.5, low=0)
    turning_radius_m: float = setting(8.0, above=0)
    turning_at_m: float = setting(24.0)  # where the first leaves the street; others 16 m further each
    mode: Mode = setting("coloured")  # contrast: bodies and key points in colours that tell them apart


@dataclass(frozen=True, eq=False)
class Car:
    """A body on the road, parked or driving evenly along it."""

    id: int
    body: Body
    skin: Skin
    road: Road
    along_m: float  # at time 0
    aside_m: float
    turn_rad: float  # from the road's heading
    speed_m_s: float = 0.0  # along the road, negative against it
    rear_axle_m: float = 0.0  # how far behind its middle the point is that follows the road

    @property
    def category(self) -> str:
        """Its class."""
        return self.body.category

    @property
    def vertices(self) -> Floats:
        """Vertices (V, 3), in object."""
        return self.body.vertices

    @property
    def faces(self) -> Ints:
        """Faces (F, 3)."""
        return self.body.faces

    @property
    def keypoints(self) -> dict[str, Floats]:
        """Key points (3,), in object."""
        return self.body.keypoints

    @property
    def moves(self) -> bool:
        """Whether it is on the way."""
        return self.speed_m_s != 0.0

    @property
    def start(self) -> Pose:
        """world_from_object at time 0."""
        return self.at(0.0)

    def at(self, time_s: float) -> Pose:
        """world_from_object at a time."""
        height, behind = float(self.body.dimensions[2]) / 2, self.rear_axle_m
        along_m = self.along_m + self.speed_m_s * time_s - behind
        pose = self.road.pose(along_m, self.aside_m, height, self.turn_rad)
        return pose @ Pose(np.eye(3), np.array([behind, 0.0, 0.0])) if behind else pose

    def velocity(self, time_s: float) -> Floats:
        """Velocity (3,) in world, m/s, of its middle."""
        before, after = (self.at(time_s + sign * _INSTANT_S).translation for sign in (-1, 1))
        found: Floats = (after - before) / (2 * _INSTANT_S)
        return found


@dataclass(frozen=True, eq=False)
class Street:
    """Everything that there is, and who looks at it when."""

    seed: int
    camera: Camera
    times_s: Floats  # (n,)
    world_from_camera: tuple[Pose, ...]
    camera_height_m: float
    kerb_m: float
    road: Road
    cars: tuple[Car, ...]
    walls: tuple[Wall, ...]
    mode: Mode = "coloured"
    imu: ImuReadings | None = None  # None: it is simulated
    drive: int = 0  # how often it was driven through before
    distortion: Distortion | None = None  # the lens that images are drawn through; `camera` is its pinhole view

    def project(self, points_in_camera: Floats) -> tuple[Floats, Floats]:
        """Pixels (n, 2) of the images as they are drawn, and the depths (n,), or with a lens the ranges, of points."""
        if self.distortion is None:
            return self.camera.project(points_in_camera), points_in_camera[:, 2]
        return self.distortion.project_raw(points_in_camera), np.linalg.norm(points_in_camera, axis=1)


def make_street(bodies: Category | BodySource, seed: int = 0, config: StreetConfig | None = None) -> Street:
    """Draw a street along a road that bends as the configuration says: the same seed gives the same street."""
    config = config or StreetConfig()
    times_s: Floats = np.arange(config.frames) * np.float64(config.frame_interval_s)
    road = bending_road(config)
    poses = tuple(_camera_at(road, t, config) for t in times_s)
    return furnished(bodies, seed, config, road, times_s, poses, street_camera(config))


def driven_again(street: Street, config: StreetConfig) -> Street:
    """The same street on a second drive, in which the camera sways to the other side; its IMU errs anew."""
    other = replace(config, sway_m=-2 * config.sway_m)
    poses = tuple(_camera_at(street.road, t, other) for t in street.times_s)
    return replace(street, drive=street.drive + 1, world_from_camera=poses, imu=None)


def street_camera(config: StreetConfig) -> Camera:
    """A camera whose horizon lies a little above the image's middle."""
    centre = (config.width_px - 1) / 2, 0.42 * config.height_px
    return Camera(config.width_px, config.height_px, config.focal_px, config.focal_px, *centre)


def street_lens(config: StreetConfig) -> Distortion | None:
    """The fisheye, its axis in the image's middle; None for a pinhole camera."""
    if config.lens == "pinhole":
        return None
    focal_px = config.width_px / float(np.radians(config.field_deg))
    centre = (config.width_px - 1) / 2, (config.height_px - 1) / 2
    raw = Camera(config.width_px, config.height_px, focal_px, focal_px, *centre)
    return undistorted(raw, np.zeros(4), "equidistant")[0]


def furnished(
    bodies: Category | BodySource,
    seed: int,
    config: StreetConfig,
    road: Road,
    times_s: Floats,
    world_from_camera: tuple[Pose, ...],
    camera: Camera,
) -> Street:
    """Put cars and house fronts along a road; the first camera is at 0 m."""
    draw = shapes_of(bodies, config.max_z) if isinstance(bodies, Category) else bodies
    rng = np.random.default_rng(seed)
    cars: list[Car] = []
    for side in (-1.0, 1.0):
        along = config.first_car_m + rng.uniform(0.0, 3.0)
        for k in range(config.cars_each_side):
            if config.spread:
                along = _even_place(k, side, world_from_camera, config)
            car = _parked_car(len(cars) + 1, side, along, road, draw(rng), rng, config)
            along += float(car.body.dimensions[0]) + rng.uniform(config.min_gap_m, config.max_gap_m)
            cars.append(car)
    turns_off = [
        turning_line(road, config.turning_at_m + 16.0 * k, config.lane_m, config.turning_radius_m)
        for k in range(config.turning_cars)
    ]
    cars = [
        car
        for car in _clear(cars, world_from_camera)
        if not any(near(line, car.start.translation) for line in turns_off)
    ]
    cars = [replace(car, id=i + 1) for i, car in enumerate(cars)]
    for k in range(config.moving_cars):
        car = _moving_car(len(cars) + 1, k, road, draw(rng), rng, config)
        cars.append(_kept_ahead(car, times_s, world_from_camera, config))
    for line in turns_off:
        cars.append(_turning_car(len(cars) + 1, line, draw(rng), rng, config))
    walls = walls_along(road, rng, config.kerb_m)
    walls = tuple(wall for wall in walls if not any(crosses(line, wall) for line in turns_off))
    lens = street_lens(config)
    return Street(
        seed,
        camera if lens is None else lens.camera,
        times_s,
        world_from_camera,
        config.camera_height_m,
        config.kerb_m,
        road,
        tuple(cars),
        walls,
        config.mode,
        distortion=lens,
    )


def bending_road(config: StreetConfig, behind_m: float = 12.0, ahead_m: float = 112.0) -> Road:
    """A level road whose heading swings as a sine; straight on behind the first camera, which stands at x = 0."""
    way = config.speed_m_s * config.frame_interval_s * config.frames
    along = np.arange(-behind_m, ahead_m + way + 1.0)
    swing = np.radians(config.bend_deg) * np.sin(2 * np.pi * np.maximum(along, 0.0) / config.bend_length_m)
    steps = np.column_stack([np.cos(swing), np.sin(swing), np.zeros(len(along))])
    line = np.cumsum(steps, axis=0)
    return Road(line - line[np.searchsorted(along, 0.0)], -behind_m)


def _camera_at(road: Road, time_s: float, config: StreetConfig) -> Pose:
    """The camera swings gently within its lane, and nods."""
    along = config.speed_m_s * time_s
    aside = -config.lane_m + config.sway_m * np.sin(0.15 * along)
    yaw, pitch = np.arctan(config.sway_m * 0.15 * np.cos(0.15 * along)), 0.004 * np.sin(0.9 * along)
    place = road.point(along, float(aside)) + [0.0, 0.0, config.camera_height_m]
    turn = Pose.from_yaw(road.heading_rad(along) + float(yaw), place)
    c, s = np.cos(pitch), np.sin(pitch)
    nod = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return Pose(turn.rotation @ nod @ FORWARD_FROM_CAMERA, turn.translation)


def _even_place(k: int, side: float, world_from_camera: tuple[Pose, ...], config: StreetConfig) -> float:
    """Where the k-th car of a side begins, if all stand evenly from the first one's place to beyond the drive's end."""
    path = np.array([pose.translation for pose in world_from_camera])
    end = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) + _BEYOND_M
    share = (2 * k + (side > 0)) / max(1, 2 * config.cars_each_side - 1)
    return config.first_car_m + share * (end - config.first_car_m)


def _parked_car(
    number: int, side: float, rear_m: float, road: Road, body: Body, rng: np.random.Generator, config: StreetConfig
) -> Car:
    """A car at the right (-1) or left (+1) kerb; those at the left mostly face the camera."""
    length, width, _ = body.dimensions
    faces_camera = rng.random() < (0.8 if side > 0 else 0.1)
    turn = (np.pi if faces_camera else 0.0) + rng.normal(0.0, 0.03)
    aside = side * (config.kerb_m - 0.2 - width / 2)
    return Car(number, body, body.looks(rng), road, rear_m + length / 2, aside, float(turn))


def _clear(cars: list[Car], world_from_camera: tuple[Pose, ...]) -> list[Car]:
    """Those that stand neither in each other nor in the camera's way: a road may come back to where it was."""
    path = np.array([pose.translation[:2] for pose in world_from_camera])
    kept: list[Car] = []
    for car in cars:
        place, half = car.start.translation[:2], float(car.body.dimensions[1]) / 2
        others = [other.start.translation[:2] for other in kept]
        near = [float(np.linalg.norm(place - other)) < 2 * half for other in others]
        if not any(near) and np.linalg.norm(path - place, axis=1).min() > half + 0.8:
            kept.append(car)
    return kept


def _kept_ahead(car: Car, times_s: Floats, world_from_camera: tuple[Pose, ...], config: StreetConfig) -> Car:
    """A car in the camera's lane, fast enough that neither the camera nor a car between them drives into it."""
    places = np.array([pose.translation for pose in world_from_camera])
    driven_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    later = times_s > times_s[0]
    if car.speed_m_s <= 0 or not later.any():
        return car
    needed = (driven_m + _LEAST_AHEAD_M - config.moving_start_m)[later] / (times_s - times_s[0])[later]
    return replace(car, speed_m_s=max(car.speed_m_s, float(needed.max())))


def _moving_car(number: int, k: int, road: Road, body: Body, rng: np.random.Generator, config: StreetConfig) -> Car:
    """A car ahead in the camera's lane, or one that comes towards it in the other."""
    skin, speed, further = body.looks(rng), config.moving_speed_m_s, 18.0 * (k // 2)
    if k % 2 == 0:
        return Car(number, body, skin, road, config.moving_start_m + further, -config.lane_m, 0.0, speed)
    return Car(number, body, skin, road, config.oncoming_start_m + further, config.lane_m, np.pi, -speed)


def _turning_car(number: int, line: Road, body: Body, rng: np.random.Generator, config: StreetConfig) -> Car:
    """A car that comes along a way of its own; its rear axle keeps to it."""
    axle_m = _REAR_AXLE_SHARE * float(body.dimensions[0])
    return Car(number, body, body.looks(rng), line, axle_m, 0.0, 0.0, config.turning_speed_m_s, axle_m)
