"""Tracks of a car that vanished and came back go to the car of the map that they show."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.mapping import LeftOut
from meshslam.mapping.seen_again import same_place, seen_again
from meshslam.maps import CameraPath, MapObject
from meshslam.perception import encode_mask

FRAMES = 12
PLACES = {1: (30.0, 3.0), 2: (24.0, -3.5)}


@pytest.fixture(scope="module")
def poses(drive):
    return drive(FRAMES)


@pytest.fixture(scope="module")
def frames(camera, poses):
    return CameraPath(camera, tuple(range(FRAMES)), np.arange(FRAMES) * 0.1, poses, 1.65)


@pytest.fixture(scope="module")
def cars(car):
    """The map: two cars, well known."""

    def at(number, place):
        pose = Pose.from_yaw(0.05, np.array([*place, car.dimensions[2] / 2]))
        return MapObject(
            number, "car", pose, car.vertices, car.faces, views=8, pose_covariance=np.diag([0.01] * 3 + [1e-4] * 3)
        )

    return [at(number, place) for number, place in PLACES.items()]


@pytest.fixture(scope="module")
def see(car_detection, car, poses):
    """Detections of a body in some frames on a track."""

    def of(track, body, seen, first_id):
        return [
            car_detection(first_id + k, i, poses[i], body.world_from_object, car.vertices, track=track)
            for k, i in enumerate(seen)
        ]

    return of


def test_a_track_too_short_for_a_car_goes_to_the_car_that_it_shows(cars, frames, see, as_set):
    found = [*see(1, cars[0], range(5, 12), 1), *see(2, cars[1], range(5, 12), 20), *see(9, cars[0], range(2), 40)]
    left_out = [LeftOut(9, "too few views", "2"), LeftOut(4, "too small", "of nothing")]
    detections, told = seen_again(cars, as_set(FRAMES, found), left_out, frames)
    assert {d.frame for d in detections.by_track()[1]} == {0, 1, *range(5, 12)}
    assert 9 not in detections.by_track()
    assert told == [LeftOut(9, "the same object", "shows track 1 again"), left_out[1]]


def car_height(thing):
    return float(np.ptp(thing.vertices[:, 2]))


@pytest.mark.parametrize("fault", ["at once", "elsewhere", "partly", "moves"])
def test_a_track_of_another_car_stays(cars, frames, see, as_set, fault):
    aside_m = {"elsewhere": 6.5, "partly": 4.1}.get(fault, 3.0)  # the car of the map stands at 3 m
    shown = replace(cars[0], world_from_object=Pose.from_yaw(0.05, np.array([30.0, aside_m, car_height(cars[0]) / 2])))
    seen = range(5, 7) if fault == "at once" else range(2)
    found = as_set(FRAMES, [*see(1, cars[0], range(5, 12), 1), *see(9, shown, seen, 40)])
    left_out = [LeftOut(9, "moves" if fault == "moves" else "too few views")]
    assert seen_again(cars, found, left_out, frames) == (found, left_out)


def test_an_object_that_another_one_may_be_is_that_one(cars, frames, see, as_set):
    """Of three far views a car was mapped 4 m too near: so much its own covariance says."""
    found = as_set(
        FRAMES, [*see(1, cars[0], range(5, 12), 1), *see(2, cars[1], range(5, 12), 20), *see(9, cars[0], range(3), 40)]
    )
    place = cars[0].world_from_object.translation - [4.0, 0.4, 0.0]
    twice = replace(
        cars[0],
        id=9,
        views=3,
        world_from_object=Pose(cars[0].world_from_object.rotation, place),
        pose_covariance=np.diag([4.0, 0.1, 0.1, 1e-3, 1e-3, 1e-3]),
    )
    detections, gone = same_place([*cars, twice], found, frames)
    assert gone == {9: LeftOut(9, "the same object", "shows track 1 again")}
    assert len(detections.by_track()[1]) == 10
    sure = replace(twice, pose_covariance=np.diag([0.2, 0.1, 0.1, 1e-3, 1e-3, 1e-3]))
    assert same_place([*cars, sure], found, frames) == (found, {})


def test_a_mask_over_two_cars_is_neithers(cars, frames, see, as_set):
    """A network may take two neighbours for one: its mask agrees with each by about a half."""
    twins = [
        replace(cars[0], id=number, world_from_object=Pose.from_yaw(0.0, np.array([x, y, car_height(cars[0]) / 2])))
        for number, x, y in ((1, 29.6, 1.0), (2, 30.0, -1.2))
    ]
    one, other = (see(9, thing, range(2), 40) for thing in twins)
    both = []
    for a, b in zip(one, other, strict=True):
        mask = a.mask() | b.mask()
        rows, columns = np.nonzero(mask)
        box = tuple(map(float, (columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1)))
        both.append(replace(a, bbox=box, segmentation=encode_mask(mask)))
    found = as_set(FRAMES, [*see(1, twins[0], range(5, 12), 1), *see(2, twins[1], range(5, 12), 20), *both])
    left_out = [LeftOut(9, "too few views")]
    assert seen_again(twins, found, left_out, frames) == (found, left_out)
    assert seen_again(twins[:1], found, left_out, frames)[1][0].reason == "the same object"
