import numpy as np
import pytest

from meshslam.simulation import StreetConfig, make_street


@pytest.mark.parametrize("seed", range(5))
def test_cars_stand_on_the_ground_apart_from_each_other_and_out_of_the_cameras_way(car, seed):
    street = make_street(car, seed, StreetConfig(frames=10))
    path = np.array([pose.translation for pose in street.world_from_camera])
    boxes = []
    for body in street.cars:
        placed = body.start.transform(body.vertices)
        assert placed[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        assert np.abs(body.vertices.max(0) + body.vertices.min(0)).max() < 1e-9
        if not body.moves:
            boxes.append((placed.min(0), placed.max(0)))
            near = (path[:, 0] > placed[:, 0].min() - 2) & (path[:, 0] < placed[:, 0].max() + 2)
            assert (np.abs(placed[:, 1][:, None] - path[near, 1][None]) > 0.8).all()
    for i, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[i + 1 :]:
            assert (low[:2] > other_high[:2]).any() or (high[:2] < other_low[:2]).any()


def test_one_car_moves_evenly_and_no_other(street):
    moving = [body for body in street.cars if body.moves]
    assert len(moving) == 1
    step = moving[0].at(0.3).translation - moving[0].at(0.1).translation
    np.testing.assert_allclose(step, [0.2 * moving[0].speed_m_s, 0.0, 0.0], atol=1e-9)
    assert all(np.array_equal(b.at(5.0).matrix, b.start.matrix) for b in street.cars if not b.moves)


def test_the_camera_never_drives_into_a_car_before_it(car):
    street = make_street(car, 2, StreetConfig(frames=120, moving_cars=3))
    ahead, further = (body for body in street.cars if body.speed_m_s > 0)
    for time_s, pose in zip(street.times_s, street.world_from_camera, strict=True):
        rear, front = (ahead.at(time_s).translation[0] + half * ahead.body.dimensions[0] for half in (-0.5, 0.5))
        assert rear - pose.translation[0] > 2.0
        assert further.at(time_s).translation[0] - further.body.dimensions[0] / 2 - front > 2.0


def test_another_seed_is_another_street(car):
    a, b = (make_street(car, seed, StreetConfig(frames=2)) for seed in (0, 1))
    assert not np.allclose(a.cars[0].vertices, b.cars[0].vertices)


def test_the_camera_looks_along_its_path_and_is_upright(street):
    for pose in street.world_from_camera:
        assert pose.rotation[0, 2] > 0.99  # forward is x
        assert pose.rotation[2, 1] < -0.99  # the image's down is the world's down
        assert np.linalg.det(pose.rotation) == pytest.approx(1.0)


def test_a_street_that_bends_takes_cars_fronts_and_camera_with_it(car):
    street = make_street(car, 2, StreetConfig(frames=40, bend_deg=20.0, moving_cars=2))
    headings = [np.arctan2(pose.rotation[1, 2], pose.rotation[0, 2]) for pose in street.world_from_camera]
    assert np.degrees(np.ptp(headings)) > 15.0
    for body in street.cars:
        at = body.at(1.0)
        road = street.road.heading_rad(body.along_m + body.speed_m_s)
        across = np.sin(at.yaw_rad - road)
        assert abs(across) < 0.15
        along, aside = street.road.coordinates(at.translation[None])
        assert along[0] == pytest.approx(body.along_m + body.speed_m_s, abs=0.1)
        assert aside[0] == pytest.approx(body.aside_m, abs=0.05)
    kinds = {np.sign(body.speed_m_s) for body in street.cars if body.moves}
    assert kinds == {1.0, -1.0}
    _, aside = street.road.coordinates(np.array([pose.translation for pose in street.world_from_camera]))
    assert np.abs(aside + 1.1).max() < 0.3  # the right lane


def test_a_car_turns_off_to_its_right_by_its_rear_axle_and_nothing_stands_in_its_way(car):
    config = StreetConfig(frames=10, turning_cars=1, moving_cars=0, bend_deg=8.0)
    street = make_street(car, 3, config)
    [turning] = [body for body in street.cars if body.moves]
    times = np.arange(0.0, 8.0, 0.1)
    yaws = np.unwrap([turning.at(float(t)).yaw_rad for t in times])
    assert np.degrees(yaws[-1] - yaws[0]) == pytest.approx(-90.0, abs=6.0)
    rates = np.diff(yaws) / 0.1
    assert rates.min() == pytest.approx(-config.turning_speed_m_s / config.turning_radius_m, rel=0.15)
    for t in times:
        pose, velocity = turning.at(float(t)), turning.velocity(float(t))
        yaw_rate = (turning.at(float(t + 0.05)).yaw_rad - turning.at(float(t - 0.05)).yaw_rad + np.pi) % (
            2 * np.pi
        ) - np.pi
        rear = velocity - 10.0 * yaw_rate * turning.rear_axle_m * pose.rotation[:, 1]
        assert abs(rear @ pose.rotation[:, 1]) < 0.25  # it does not skid
        assert np.linalg.norm(rear) == pytest.approx(config.turning_speed_m_s, abs=0.15)
        for other in street.cars:
            if not other.moves:
                assert np.linalg.norm(other.start.translation[:2] - pose.translation[:2]) > 2.0
        for wall in street.walls:
            along = np.linspace(0, 1, 40)[:, None]
            line = wall.start + along * (wall.end - wall.start)
            assert np.linalg.norm(line[:, :2] - pose.translation[:2], axis=1).min() > 2.0
