"""Every message that the node builds, through serialize and deserialize, with the fields' types checked."""

import os

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry, Path
from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from meshslam.geometry import Pose
from meshslam.ros2 import messages
from meshslam.ros2.conventions import UNKNOWN_VARIANCE, pose_covariance_in_parent

STAMP = 1_700_000_123_456_789_012
POSE = Pose.exp(np.array([1.0, -2.0, 3.0, 0.4, -0.3, 2.0]))


def sent(message, kind):
    assert os.environ["ROS_PYTHON_CHECK_FIELDS"] == "1"
    return deserialize_message(serialize_message(message), kind)


def ns(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


def pose_of(message):
    p, q = message.position, message.orientation
    return Pose.from_quaternion(np.array([q.x, q.y, q.z, q.w]), np.array([p.x, p.y, p.z]), order="xyzw")


def test_fields_are_checked_in_these_tests():
    with pytest.raises(AssertionError):
        Odometry(child_frame_id=3)


def test_odometry(rng):
    half = rng.normal(0, 0.1, (6, 6))
    covariance = half @ half.T
    twist = (np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3]))
    told = sent(messages.odometry_message("map", "base_link", STAMP, POSE, covariance, twist), Odometry)
    assert (told.header.frame_id, told.child_frame_id, ns(told.header.stamp)) == ("map", "base_link", STAMP)
    np.testing.assert_allclose(pose_of(told.pose.pose).matrix, POSE.matrix, atol=1e-12)
    assert told.pose.covariance.shape == told.twist.covariance.shape == (36,)
    expected = pose_covariance_in_parent(POSE, covariance)
    np.testing.assert_array_equal(told.pose.covariance.reshape(6, 6), expected)
    v, w = told.twist.twist.linear, told.twist.twist.angular
    assert (v.x, v.y, v.z, w.x, w.y, w.z) == (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)


def test_odometry_that_is_not_sure_says_so():
    told = sent(messages.odometry_message("map", "camera", STAMP, POSE, None, None), Odometry)
    unknown = np.eye(6) * UNKNOWN_VARIANCE
    np.testing.assert_array_equal(told.pose.covariance.reshape(6, 6), unknown)
    np.testing.assert_array_equal(told.twist.covariance.reshape(6, 6), unknown)
    assert told.twist.twist.linear.x == 0.0


def test_path():
    poses = [messages.stamped_pose("map", STAMP + k, Pose(np.eye(3), np.array([k, 0, 0]))) for k in range(5)]
    told = sent(messages.path_message("map", STAMP, poses), Path)
    assert told.header.frame_id == "map"
    assert [ns(p.header.stamp) - STAMP for p in told.poses] == [0, 1, 2, 3, 4]
    assert [p.pose.position.x for p in told.poses] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert all(p.pose.orientation.w == 1.0 for p in told.poses)


def test_transform():
    told = sent(messages.transform_message("map", "base_link", STAMP, POSE), TransformStamped)
    moved, turned = told.transform.translation, told.transform.rotation
    pose = Pose.from_quaternion(
        np.array([turned.x, turned.y, turned.z, turned.w]), np.array([moved.x, moved.y, moved.z]), order="xyzw"
    )
    np.testing.assert_allclose(pose.matrix, POSE.matrix, atol=1e-12)
    assert (told.header.frame_id, told.child_frame_id) == ("map", "base_link")


def test_a_cars_own_mesh(car):
    told = sent(messages.marker_array([messages.object_marker("map", STAMP, car)]), MarkerArray).markers[0]
    assert (told.ns, told.id, told.type, told.action) == ("car", 7, Marker.TRIANGLE_LIST, Marker.ADD)
    assert (told.header.frame_id, ns(told.header.stamp)) == ("map", STAMP)
    assert (told.scale.x, told.scale.y, told.scale.z) == (1.0, 1.0, 1.0)
    assert (told.lifetime.sec, told.lifetime.nanosec, told.frame_locked) == (0, 0, False)
    np.testing.assert_allclose(pose_of(told.pose).matrix, car.world_from_object.matrix, atol=1e-12)
    points = np.array([[p.x, p.y, p.z] for p in told.points])
    np.testing.assert_array_equal(points, car.vertices[car.faces.ravel()])
    colours = np.array([[c.r, c.g, c.b, c.a] for c in told.colors])
    assert colours.shape == (3 * len(car.faces), 4)
    assert (colours[:, 3] == 1.0).all()
    assert ((colours >= 0) & (colours <= 1)).all()


def test_colour_tells_sigma(car):
    told = messages.object_marker("map", STAMP, car)
    sigmas, greens = car.vertex_sigma_m[car.faces.ravel()], np.array([c.g for c in told.colors])
    reds = np.array([c.r for c in told.colors])
    order = np.argsort(sigmas)
    assert (np.diff(greens[order]) <= 1e-9).all()
    assert (np.diff(reds[order]) >= -1e-9).all()
    assert greens[sigmas < 0.03].min() > reds[sigmas < 0.03].max()
    assert reds[sigmas > 0.15].min() > greens[sigmas > 0.15].max()


def test_deletions():
    one = messages.deleted_marker("map", STAMP, "car", np.int64(7))
    told = sent(messages.marker_array([one, messages.all_deleted_marker("map", STAMP)]), MarkerArray).markers
    assert [(m.ns, m.id, m.action) for m in told] == [("car", 7, Marker.DELETE), ("", 0, Marker.DELETEALL)]


def test_diagnostics():
    rows = [("images", 0, "comes", {"received": 3, "share": 0.5}), ("IMU", 2, "nothing", {})]
    told = sent(messages.diagnostic_array(STAMP, rows), DiagnosticArray)
    assert ns(told.header.stamp) == STAMP
    assert [s.level for s in told.status] == [DiagnosticStatus.OK, DiagnosticStatus.ERROR]
    assert [s.name for s in told.status] == ["images", "IMU"]
    assert {v.key: v.value for v in told.status[0].values} == {"received": "3", "share": "0.5"}
