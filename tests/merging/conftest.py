"""A street of parked cars as several drives have it, each in a world of its own."""

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject, Trajectory
from meshslam.merging import Drive, DriveViews
from tests.fixtures.parked_street import WORLD_FROM_FORWARD, as_set, camera, car, car_detection

__all__ = ["as_set", "camera", "car", "car_detection"]
POSITION_SIGMA_M, HEADING_SIGMA_RAD = 0.05, 0.01
FRAMES = 40


def any_pose(rng):
    """A world turned about z and moved."""
    return Pose.from_yaw(float(rng.uniform(-np.pi, np.pi)), rng.uniform(-100, 100, 3) * [1, 1, 0.05])


@pytest.fixture(scope="session")
def street(car):
    """Make the cars of a street along x, by number: poses and meshes."""

    def make(seed, count=10, spacing_m=5.0):
        rng = np.random.default_rng(seed)
        cars = {}
        for k in range(count):
            shape = car.vertices + 0.6 * np.tensordot(rng.normal(size=len(car.modes)), car.modes, 1)
            shape = shape - (shape.max(0) + shape.min(0)) / 2
            side = 1 if k % 2 else -1
            place = [spacing_m * k + rng.uniform(-1.2, 1.2), side * rng.uniform(3.6, 4.6), np.ptp(shape[:, 2]) / 2]
            yaw = rng.normal(0, 0.03) + np.pi * (rng.random() < 0.3)
            cars[k + 1] = Pose.from_yaw(float(yaw), np.array(place)), shape
        return cars

    return make


@pytest.fixture(scope="session")
def drive_by(car):
    """Make a drive's map of a street: its own world, its own errors, its own numbers of cars."""

    def make(name, cars, seed, *, world=None, path=None, views=None, numbers_from=0, scale=1.0, turned=()):
        rng = np.random.default_rng([3, seed])
        drive_from_street = any_pose(rng) if world is None else world
        objects = []
        for number, (pose, vertices) in cars.items():
            error = np.concatenate([rng.normal(0, POSITION_SIGMA_M, 3), [0, 0, rng.normal(0, HEADING_SIGMA_RAD)]])
            placed = (drive_from_street @ pose).retract(scale * error)
            objects.append(
                MapObject(
                    id=number + numbers_from,
                    category="car",
                    world_from_object=placed @ Pose.from_yaw(np.pi, np.zeros(3)) if number in turned else placed,
                    vertices=vertices + rng.normal(0, 0.01, vertices.shape),
                    faces=car.faces,
                    views=8,
                    first_frame=5,
                    last_frame=12,
                    mask_iou=0.9,
                    pose_covariance=np.diag([POSITION_SIGMA_M**2] * 3 + [HEADING_SIGMA_RAD**2] * 3),
                    vertex_sigma_m=np.full(len(vertices), 0.03),
                    vertex_observed=np.ones(len(vertices), bool),
                ).recentred()
            )
        poses = camera_path() if path is None else path
        moved = tuple(drive_from_street @ pose for pose in poses)
        times = 1000.0 * seed + 0.1 * np.arange(len(poses))
        return Drive(name, Map(tuple(objects)), Trajectory(times, moved), views), drive_from_street

    return make


def camera_path(count=FRAMES, y=0.0, start=-8.0, step=1.5):
    """Poses along x, 1.65 m over the road."""
    return tuple(Pose(WORLD_FROM_FORWARD, np.array([start + step * i, y, 1.65])) for i in range(count))


@pytest.fixture(scope="session")
def seen_cars(camera, as_set, car_detection):
    """Make the views of a path: exact detections of cars that are near, on tracks of their numbers."""

    def make(cars, path, numbers_from=0, reach_m=18.0):
        found = []
        for frame, pose in enumerate(path):
            for number, (place, vertices) in cars.items():
                points = pose.inverse().transform(place.transform(vertices))
                ahead = points[:, 2].min() > 2.0 and points[:, 2].mean() < reach_m
                if not ahead:
                    continue
                pixels = camera.project(points)
                if pixels[:, 0].min() < -60 or pixels[:, 0].max() > camera.width + 60:
                    continue
                others = [(p, v) for k, (p, v) in cars.items() if k != number]
                near = [
                    (p, v) for p, v in others if 0 < pose.inverse().transform(p.translation)[2] < points[:, 2].mean()
                ]
                try:
                    seen = car_detection(len(found) + 1, frame, pose, place, vertices, near, number + numbers_from)
                except ValueError:  # hidden
                    continue
                if seen.area_px > 300:
                    found.append(seen)
        return DriveViews(camera, tuple(range(len(path))), as_set(len(path), found), 1.65)

    return make
