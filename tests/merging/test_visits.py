"""What each drive says of each car: seen, moved, gone, hidden, not in view."""

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.merging import MergingConfig, merge_drives
from tests.merging.conftest import camera_path

NO_VIEWS = MergingConfig(use_views=False)


def without(cars, *numbers):
    return {k: v for k, v in cars.items() if k not in numbers}


def moved(cars, number, metres):
    pose, vertices = cars[number]
    return cars | {number: (pose @ Pose(np.eye(3), np.array([metres, 0.0, 0.0])), vertices)}


@pytest.fixture(scope="module")
def passes(street, drive_by, seen_cars):
    """Make drives past the same street as it was each time."""

    def make(*streets, path=None):
        path = camera_path() if path is None else path
        return tuple(
            drive_by(f"d{k}", cars, k + 1, views=seen_cars(cars, path), path=path)[0] for k, cars in enumerate(streets)
        )

    return make


def by_number(merged, number):
    """The car that any drive has under a number, and its visits' statuses."""
    [car] = [c for c in merged.worlds[0].cars if any(v.number == number for v in c.visits)]
    return car, [visit.status for visit in car.visits]


def test_parked_cars_are_seen_by_all(passes, street):
    merged = merge_drives(passes(street(1), street(1)), NO_VIEWS)
    assert {car.status for car in merged.worlds[0].cars} == {"parked"}
    assert {visit.status for car in merged.worlds[0].cars for visit in car.visits} == {"seen"}


def test_a_car_that_left_is_gone_and_kept_apart(passes, street):
    cars = street(2)
    merged = merge_drives(passes(cars, without(cars, 5)), NO_VIEWS)
    car, visits = by_number(merged, 5)
    assert visits == ["seen", "gone"]
    assert car.status == "gone"
    assert car.thing.id in merged.worlds[0].gone
    assert car.thing.id not in merged.map
    assert any(note.startswith(f"car {car.thing.id}: gone since d1") for note in merged.notes)


def test_a_car_that_came_is_new(passes, street):
    cars = street(3)
    merged = merge_drives(passes(without(cars, 4), cars), NO_VIEWS)
    car, visits = by_number(merged, 4)
    assert visits == ["absent", "seen"]
    assert car.status == "new"
    assert car.thing.id in merged.map


@pytest.mark.parametrize("metres", [0.8, 2.5])
def test_a_car_that_moved_is_one_car_at_its_last_place(passes, street, metres):
    cars = without(street(4, 12), 7)  # room to move
    merged = merge_drives(passes(cars, moved(cars, 5, metres)), NO_VIEWS)
    car, visits = by_number(merged, 5)
    assert car.status == "moved"
    assert visits == ["moved", "seen"]
    assert car.visits[0].apart_m == pytest.approx(metres, abs=0.25)
    assert len(merged.map) == len(cars)
    assert any(f"car {car.thing.id}: moved by" in note for note in merged.notes)


def test_another_car_in_the_same_place_has_taken_it(passes, street):
    cars = street(5)
    pose, vertices = cars[6]
    other = cars | {6: (pose, vertices * [1.25, 1.0, 1.0])}
    merged = merge_drives(passes(cars, other), NO_VIEWS)
    statuses = sorted(car.status for car in merged.worlds[0].cars if any(v.number == 6 for v in car.visits))
    assert statuses.count("gone") == 1
    assert len(merged.map) == len(cars)


def test_a_place_that_a_drive_did_not_pass_says_nothing(passes, street, drive_by, seen_cars):
    cars = street(6, 16)
    short = camera_path(16)
    mapped = {k: v for k, v in cars.items() if v[0].translation[0] < 30}
    one = drive_by("whole", cars, 1)[0]
    two = drive_by("part", mapped, 2, views=seen_cars(cars, short, reach_m=40.0), path=short)[0]
    merged = merge_drives((one, two), NO_VIEWS)
    assert by_number(merged, 16)[1] == ["seen", "not_in_view"]
    assert not len(merged.worlds[0].gone)


def test_a_car_behind_another_is_hidden_not_gone(street, drive_by, seen_cars):
    cars = street(7)
    pose, vertices = cars[4]
    tall = vertices * [1.3, 1.0, 2.2]
    behind = Pose.from_yaw(
        0.0, pose.translation * [1, 1, 0] + np.array([0.0, np.sign(pose.translation[1]) * 2.6, 0.75])
    )
    full = cars | {99: (behind, cars[2][1])}
    wall = cars | {
        4: (Pose(pose.rotation, pose.translation * [1, 1, 0] + np.array([0, 0, np.ptp(tall[:, 2]) / 2])), tall),
        98: (Pose.from_yaw(0.0, behind.translation * [1, 0, 0] + np.array([-5.2, pose.translation[1], 1.6])), tall),
    }
    path = camera_path()
    one = drive_by("one", full, 1, views=seen_cars(full, path))[0]
    two = drive_by("two", wall, 2, views=seen_cars(wall, path))[0]
    _, visits = by_number(merge_drives((one, two), NO_VIEWS), 99)
    assert visits[0] == "seen"
    assert visits[1] in ("hidden", "not_in_view")


def test_a_car_that_was_detected_but_not_mapped_is_there(passes, street, drive_by, seen_cars):
    cars, path = street(8), camera_path()
    one = drive_by("one", cars, 1, views=seen_cars(cars, path))[0]
    two = drive_by("two", without(cars, 3), 2, views=seen_cars(cars, path))[0]
    car, visits = by_number(merge_drives((one, two), NO_VIEWS), 3)
    assert visits == ["seen", "detected"]
    assert car.status == "parked"


def test_without_frames_nothing_is_said_of_a_place(street, drive_by):
    cars = street(9)
    one, two = drive_by("one", cars, 1)[0], drive_by("two", without(cars, 2), 2)[0]
    car, visits = by_number(merge_drives((one, two), NO_VIEWS), 2)
    assert visits == ["seen", "unknown"]
    assert car.status == "parked"
