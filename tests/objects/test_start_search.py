import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.geometry.object_model import GroundPlane
from meshslam.objects import ObjectConfig
from meshslam.objects.start_search import (
    flipped,
    pose_from_keypoints,
    rough_position,
    triangulate_keypoints,
    upright,
    yaw_starts,
)
from meshslam.objects.track import Track

CONFIG = ObjectConfig()


def degrees_between(a, b):
    return np.degrees(np.arccos(np.clip((np.trace(a.rotation.T @ b.rotation) - 1) / 2, -1, 1)))


@pytest.fixture
def make_track(car, car_detection, drive):
    def make(true, vertices, count=8):
        poses = drive(count)
        found = tuple(car_detection(i + 1, i, p, true, vertices) for i, p in enumerate(poses))
        return Track(1, found, poses, np.arange(count) * 0.1)

    return make


def test_exact_key_points_are_triangulated_where_they_are(camera, car, make_track):
    true = Pose.from_yaw(0.4, np.array([14.0, 3.0, 0.8]))
    found = triangulate_keypoints(make_track(true, car.vertices), car.keypoint_names, car, camera, CONFIG)
    expected = true.transform(car.keypoints(car.vertices))
    assert sorted(found) == list(range(12))
    for k, (point, covariance) in found.items():
        np.testing.assert_allclose(point, expected[k], atol=1e-3)
        assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_one_view_or_one_place_fixes_nothing(camera, car, make_track):
    track = make_track(Pose.from_yaw(0.0, np.array([14.0, 3.0, 0.8])), car.vertices, count=1)
    assert triangulate_keypoints(track, car.keypoint_names, car, camera, CONFIG) == {}
    twice = Track(1, track.detections * 2, track.world_from_camera * 2, np.array([0.0, 0.1]))
    assert triangulate_keypoints(twice, car.keypoint_names, car, camera, CONFIG) == {}


@pytest.mark.parametrize("seed", range(6))
def test_the_pose_survives_a_fifth_of_wild_key_points(camera, car, make_track, seed):
    rng = np.random.default_rng(seed)
    true = Pose.from_yaw(rng.uniform(-np.pi, np.pi), np.array([13.0, rng.choice([-1, 1]) * 3.5, 0.78]))
    track = make_track(true, car.shape(rng.normal(0, 0.5, 8)))
    for detection in track.detections:
        detection.keypoints[:] += rng.normal(0, 1.5, (12, 2))
        wild = rng.permutation(12) < 2 + (rng.random() < 0.4)  # 2.4 of 12
        x, y, w, h = detection.bbox
        detection.keypoints[wild] = [x, y] + rng.random((wild.sum(), 2)) * [w, h]
    points = triangulate_keypoints(track, car.keypoint_names, car, camera, CONFIG)
    pose = pose_from_keypoints(points, car)
    assert np.linalg.norm(pose.translation - true.translation) < 0.35
    assert degrees_between(pose, true) < 6


@pytest.mark.parametrize("seed", range(6))
def test_wild_points_in_space_are_left_out_of_the_pose(car, seed):
    rng = np.random.default_rng(seed)
    true = Pose.from_yaw(rng.uniform(-np.pi, np.pi), rng.normal(0, 5, 3))
    places = true.transform(car.keypoints(car.vertices)) + rng.normal(0, 0.03, (12, 3))
    wild = rng.permutation(12) < 3
    places[wild] += rng.uniform(2, 5, (3, 1)) * rng.choice([-1, 1], (3, 3))
    pose = pose_from_keypoints({k: (places[k], 1e-3 * np.eye(3)) for k in range(12)}, car)
    assert np.linalg.norm(pose.translation - true.translation) < 0.08
    assert degrees_between(pose, true) < 2


def test_fewer_than_four_points_give_no_pose(car, rng):
    places = car.keypoints(car.vertices)
    assert pose_from_keypoints({k: (places[k], 1e-4 * np.eye(3)) for k in range(3)}, car) is None
    scattered = {k: (rng.uniform(-30, 30, 3), 1e-4 * np.eye(3)) for k in range(8)}
    assert pose_from_keypoints(scattered, car) is None


def test_flipping_twice_changes_nothing_and_once_swaps_front_and_rear(rng):
    pose = Pose.from_yaw(0.7, rng.normal(0, 3, 3))
    np.testing.assert_allclose(flipped(flipped(pose)).matrix, pose.matrix)
    np.testing.assert_allclose(flipped(pose).rotation[:, 0], -pose.rotation[:, 0])
    np.testing.assert_array_equal(flipped(pose).rotation[:, 2], pose.rotation[:, 2])
    np.testing.assert_array_equal(flipped(pose).translation, pose.translation)
    assert np.linalg.det(flipped(pose).rotation) == pytest.approx(1.0)


def test_upright_stands_on_the_road_and_keeps_the_heading(rng):
    for _ in range(20):
        normal = np.array([*rng.normal(0, 0.1, 2), 1.0])
        normal /= np.linalg.norm(normal)
        ground = GroundPlane(normal, 0.0, 0.1, 0.03)
        tilted = Pose.from_yaw(rng.uniform(-3, 3), rng.normal(0, 3, 3))
        stood = upright(tilted, ground)
        np.testing.assert_allclose(stood.rotation[:, 2], normal, atol=1e-12)
        np.testing.assert_allclose(stood.rotation.T @ stood.rotation, np.eye(3), atol=1e-12)
        assert stood.rotation[:, 0] @ tilted.rotation[:, 0] > 0.95


def test_the_rough_position_is_near_the_car(camera, car, make_track):
    for x, y in ((14.0, 3.5), (18.0, -3.0), (25.0, 0.5)):
        true = Pose.from_yaw(0.1, np.array([x, y, 0.78]))
        found = rough_position(make_track(true, car.vertices, 4), car, camera)
        assert np.linalg.norm((found - true.translation)[:2]) < 2.5


def test_starts_stand_on_the_road_at_every_heading(car):
    ground = GroundPlane(np.array([0.0, 0.0, 1.0]), 0.2, 0.1, 0.03)
    starts = yaw_starts(np.array([12.0, 2.0, 3.0]), ground, car, 16, np.array([0.0, 0.0, 1.65]))
    assert len(starts) == 48
    for pose in starts:
        assert pose.translation[2] == pytest.approx(0.2 + car.dimensions[2] / 2)
    headings = np.sort([pose.yaw_rad for pose in starts[:16]])
    np.testing.assert_allclose(np.diff(headings), 2 * np.pi / 16, atol=1e-9)
