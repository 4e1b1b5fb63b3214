"""A car that drives by an exact drive: where it was, how fast, and how certain that is."""

import numpy as np
import pytest

from meshslam.geometry import Pose, voxel_iou
from meshslam.mapping.pipeline import make_scene
from meshslam.mapping.work import first_pass
from meshslam.maps import CameraPath
from meshslam.moving import MovingConfig, PathBounds, ShapePrior, begin_moving, finish_moving
from meshslam.objects import ObjectConfig, Occluders, Track

FRAMES, INTERVAL_S = 14, 0.1
REAR_M = 1.3
STEP_M = 0.6  # of the camera


def oncoming(i, speed=7.0):
    return Pose.from_yaw(np.pi, np.array([28.0 - speed * INTERVAL_S * i, 2.6, 0.0]))


def turning(i, speed=4.5, curvature=1 / 9.0):
    """Comes along and turns off to its right; its rear axle drives the arc."""
    heading = np.pi - speed * curvature * INTERVAL_S * i
    start = np.array([20.0, 2.6, 0.0])
    rear = start + np.array([np.sin(np.pi) - np.sin(heading), np.cos(heading) - np.cos(np.pi), 0.0]) / curvature
    return Pose.from_yaw(heading, rear + REAR_M * np.array([np.cos(heading), np.sin(heading), 0.0]))


def ahead(i):
    return Pose.from_yaw(0.0, np.array([14.0 + STEP_M * i, 0.0, 0.0]))


def standing(_i):
    return Pose.from_yaw(np.pi, np.array([20.0, 2.6, 0.0]))


@pytest.fixture(scope="module")
def estimated(car, camera, car_detection, as_set, drive):
    def of(pose_of, z=0.0, config=None, prior=None, needed=None):
        weights = np.zeros(len(car.modes))
        weights[:3] = z
        vertices = car.shape(weights)
        cameras = drive(FRAMES, STEP_M)
        stands = [0.0, 0.0, -vertices[car.wheel_vertices, 2].mean()]
        poses = [Pose(p.rotation, p.translation + stands) for p in map(pose_of, range(FRAMES))]
        seen = tuple(car_detection(i + 1, i, cameras[i], poses[i], vertices) for i in range(FRAMES))
        found = as_set(FRAMES, seen)
        times_s = INTERVAL_S * np.arange(FRAMES)
        path = CameraPath(camera, tuple(range(FRAMES)), times_s, cameras, 1.65)
        scene = make_scene(path, found, car, ObjectConfig())
        occluders = Occluders(camera, found.by_frame(), path.pose_of_frame())
        track = Track(1, seen, cameras, times_s)
        first = first_pass(track, scene, occluders)
        settings, prior = config or MovingConfig(), prior or ShapePrior.of_category(len(car.modes))
        begun = begin_moving(track, first.found.state, first.observed, scene, occluders, settings, prior)
        made = finish_moving(begun, scene, occluders, settings, prior, needed or PathBounds(25.0, 0.6))
        return made, poses, vertices

    return of


@pytest.fixture(scope="module")
def came(estimated):
    return estimated(oncoming)


@pytest.fixture(scope="module")
def turned(estimated):
    return estimated(turning)


def test_a_car_that_comes_is_placed_at_each_time(came, car):
    made, poses, vertices = came
    path = made.object.path
    gaps = [(p.inverse() @ q).translation for p, q in zip(poses, path.world_from_object, strict=True)]
    assert np.median(np.linalg.norm(gaps, axis=1)) < 0.35
    assert np.abs(path.speeds_m_s - 7.0).max() < 0.4
    np.testing.assert_allclose(path.velocity_in_world[:, :2], np.tile([-7.0, 0.0], (FRAMES, 1)), atol=0.4)
    assert voxel_iou(vertices, car.faces, made.object.vertices, made.object.faces) > 0.85


def test_a_car_that_turns_has_its_turn_rate_and_heading(turned):
    made, poses, _ = turned
    path = made.object.path
    turns = [np.degrees((p.inverse() @ q).yaw_rad) for p, q in zip(poses, path.world_from_object, strict=True)]
    assert np.median(np.abs(turns)) < 2.0
    assert np.median(path.turn_rates_rad_s) == pytest.approx(-0.5, abs=0.08)
    assert np.median(np.abs(path.speeds_m_s - 4.5)) < 0.4
    swing = np.linalg.norm(path.velocity_in_world, axis=1)
    assert np.median(swing) > np.median(path.speeds_m_s)  # its middle goes further round than its rear axle


def test_its_velocity_is_how_its_centre_moves(turned):
    path = turned[0].object.path
    moved = np.gradient(path.positions_in_world, path.times_s, axis=0)[2:-2]
    np.testing.assert_allclose(path.velocity_in_world[2:-2], moved, atol=0.35)


def test_what_is_unknown_is_the_distance(came):
    """One camera sees size and distance as one: the covariance's long axis is the ray, all poses err alike along it."""
    path = came[0].object.path
    for pose, covariance, i in zip(path.world_from_object, path.covariances, range(FRAMES), strict=True):
        along = pose.rotation @ np.linalg.eigh(covariance[:3, :3])[1][:, -1]
        ray = pose.translation - [STEP_M * i, 0.0, 1.65]
        assert abs(along @ ray) / np.linalg.norm(ray) > 0.9
        assert np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]) > 0.01 * np.linalg.norm(ray)


def test_errors_are_within_what_is_said_of_them(came, turned):
    for made, poses, _ in (came, turned):
        path = made.object.path
        gaps = np.array(
            [p.inverse().transform(q.translation) for p, q in zip(path.world_from_object, poses, strict=True)]
        )
        squared = np.einsum("ni,ni->n", gaps, np.linalg.solve(path.covariances[:, :3, :3], gaps[..., None])[..., 0])
        assert np.median(squared) < 16.3  # 99.9% of three axes
        assert (np.linalg.eigvalsh(path.covariances) > 0).all()


def test_a_car_that_stands_is_no_moving_object(estimated):
    made, _, _ = estimated(standing)
    assert made.object is None
    assert "one place" in made.doubt or "not certain" in made.doubt


def test_few_views_make_no_path(estimated):
    made, _, _ = estimated(oncoming, config=MovingConfig(min_views=FRAMES + 1))
    assert made.object is None
    assert made.doubt == f"{FRAMES} views of {FRAMES + 1} needed for a path"


def test_free_form_moves_nothing_along_the_line_of_sight(estimated, car):
    """A car that goes ahead of the camera at its speed: views alone tell no distance, so that only the path may."""
    made, poses, vertices = estimated(ahead, z=0.8)
    found = made.object
    centre = found.path.world_from_object[0].translation - [0.0, 0.0, 1.65]
    near = np.linalg.norm(centre) / np.linalg.norm(poses[0].translation - [0.0, 0.0, 1.65])
    size = np.ptp(found.vertices, axis=0)[1:] / np.ptp(vertices, axis=0)[1:]
    np.testing.assert_allclose(size, near, atol=0.03)  # as large as it is far


def test_its_size_follows_the_drives_other_cars_where_views_leave_it_open(estimated, car):
    modes = len(car.modes)
    along = int(np.argmax(np.abs(car.modes[:, :, 1]).max(1)))  # the mode that makes cars widest
    shift = np.zeros(modes)
    shift[along] = 3.0
    sizes = []
    for mean in (-shift, shift):
        prior = ShapePrior(mean, np.eye(modes))
        made, _, _ = estimated(ahead, prior=prior)
        sizes.append(np.ptp(made.object.vertices, axis=0)[1])
    expected = [np.ptp(car.shape(mean), axis=0)[1] for mean in (-shift, shift)]
    assert (sizes[1] - sizes[0]) / (expected[1] - expected[0]) > 0.2


def test_a_path_must_cost_less_and_fit_as_well_as_it_is_asked_to(estimated):
    for needed, said in (
        (PathBounds(1e6, 0.6), "agree as well with one place"),
        (PathBounds(25.0, 0.999), "does not fit its masks"),
    ):
        made, _, _ = estimated(oncoming, needed=needed)
        assert made.object is None
        assert said in made.doubt


def test_a_car_in_a_queue_is_told_from_a_larger_one_further_away(estimated):
    """It creeps, halts and creeps ahead of the camera; one velocity gains little, the path much."""
    way = np.concatenate([[0.0], np.cumsum(np.where(np.arange(FRAMES - 1) % 10 < 5, 0.3, 0.1))])
    made, _, _ = estimated(
        lambda i: Pose.from_yaw(0.0, np.array([14.0 + way[i], 2.6, 0.0])), needed=PathBounds(60.0, 0.85)
    )
    assert made.object is not None, made.doubt
    driven = made.object.path.positions_in_world[-1] - made.object.path.positions_in_world[0]
    assert driven[0] == pytest.approx(way[-1], abs=0.4)
