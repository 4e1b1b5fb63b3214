"""Covariances of a map that was fitted along an uncertain path."""

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.graph import ObjectCovariance, moved_covariance
from meshslam.maps import Map, MapObject, MovingObject, MovingPath, Trajectory, TrajectoryEstimate
from meshslam.object_slam.map_covariances import with_path_covariances

FRAMES = tuple(range(5, 25))
OWN = np.diag([0.02, 0.01, 0.01, 1e-4, 1e-4, 4e-4])


def path_covariance(i):
    """It grows along the path."""
    return np.diag([0.01, 0.02, 0.05, 1e-4, 2e-4, 3e-4]) * (1 + i)


@pytest.fixture
def estimate():
    """A camera that drives along x, looking ahead."""
    ahead = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    count = len(FRAMES)
    poses = tuple(Pose(ahead, np.array([float(i), 0.0, 1.65])) for i in range(count))
    return TrajectoryEstimate(
        Trajectory(0.1 * np.arange(count), poses),
        FRAMES,
        np.array([path_covariance(i) for i in range(count)]),
        np.zeros((count, 3)),
        None,
        ("images",) * count,
        np.zeros(count, bool),
    )


def car(number, x, first, last, covariance=OWN):
    box = np.array([[i, j, k] for i in (-2.0, 2.0) for j in (-0.9, 0.9) for k in (-0.7, 0.7)])
    faces = np.array([[0, 1, 2]], np.int32)
    pose = Pose.from_yaw(0.4, np.array([x, 3.0, 0.7]))
    return MapObject(number, "car", pose, box, faces, first_frame=first, last_frame=last, pose_covariance=covariance)


def test_an_object_of_the_graph_has_the_paths_part_as_the_graph_says(estimate):
    thing, part = car(1, 9.0, 6, 12), path_covariance(7)
    turned = thing.world_from_object @ Pose.from_yaw(np.pi, np.array([0.1, 0.0, 0.05]))  # the graph's own frame
    of_graph = {1: ObjectCovariance(turned, part + OWN, part)}
    (found,) = with_path_covariances(Map((thing,)), of_graph, estimate).objects
    expected = OWN + moved_covariance(part, turned, thing.world_from_object)
    assert found.pose_covariance == pytest.approx(expected)


@pytest.mark.parametrize(("x", "nearest"), [(9.2, 9), (30.0, 12), (0.0, 1)])
def test_an_object_that_the_graph_lacks_moves_with_the_nearest_camera_that_saw_it(estimate, x, nearest):
    thing = car(2, x, FRAMES[1], FRAMES[12])
    (found,) = with_path_covariances(Map((thing,)), {}, estimate).objects
    camera = estimate.trajectory.world_from_camera[nearest]
    expected = OWN + moved_covariance(path_covariance(nearest), camera, thing.world_from_object)
    assert found.pose_covariance == pytest.approx(expected)


def test_an_object_without_a_covariance_gets_none(estimate):
    (found,) = with_path_covariances(Map((car(3, 9.0, 6, 12, None),)), {}, estimate).objects
    assert found.pose_covariance is None


def test_what_drives_stays_in_the_map(estimate):
    body, times_s = car(7, 20.0, 6, 7), np.array([0.1, 0.2])
    poses = tuple(Pose.from_yaw(0.4, np.array([20.0 + i, 3.0, 0.7])) for i in range(2))
    ones = np.ones(2)
    path = MovingPath(times_s, (6, 7), poses, np.array([OWN, OWN]), np.zeros((2, 3)), ones, ones, ones, ones)
    moving = (MovingObject(body, 0.1, path),)
    found = with_path_covariances(Map((car(1, 9.0, 6, 12),), moving), {}, estimate)
    assert [one.id for one in found.moving] == [7]
