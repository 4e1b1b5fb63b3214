"""How the node ends, and how it is wired: with estimations that tests hold in their hands."""

import os
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from meshslam.errors import MapError, SequenceError
from meshslam.geometry import Camera, Pose
from meshslam.live import LivePose
from meshslam.maps import Map, Trajectory
from meshslam.ros2.conventions import covariance_of_body, pose_covariance_in_parent
from meshslam.ros2.node import SlamNode
from meshslam.ros2.options import NodeOptions
from meshslam.ros2.running import Signals, _end
from meshslam.ros2.saving import Saving
from meshslam.runs import Config
from meshslam.sequences import CameraFile
from tests.ros2.publisher import image_message

IMU_FROM_CAMERA = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([1.0, 0.1, 0.7]))
FIRST_S = 1_700_000_000.25


class Log:
    def __init__(self):
        self.said = []

    def info(self, text):
        self.said.append(text)

    warning = error = info


class Ending:
    """What is to be saved: at once, and after a while that a test ends."""

    def __init__(self):
        self.gate, self.steps, self.error, self.fault = threading.Event(), [], None, None

    def stop(self):
        self.steps.append("stop")

    def save(self):
        self.steps.append("save")
        if self.error is not None:
            raise self.error
        return "saved"

    def finish(self):
        self.gate.wait(10)
        self.steps.append("finish")
        return "smoothed"

    def close(self):
        self.steps.append("close")


def ended(ending, signals, *, refine=True):
    log = Log()
    node = SimpleNamespace(get_logger=lambda: log, destroy_node=lambda: None)
    executor = SimpleNamespace(shutdown=lambda timeout_sec: None)
    return _end(node, ending, signals, executor, refine=refine), log.said


def test_what_there_is_is_saved_before_it_is_smoothed():
    ending = Ending()
    ending.gate.set()
    assert ended(ending, Signals()) == (True, ["saved", "smoothed"])
    assert ending.steps == ["stop", "save", "finish", "close"]
    assert ended(ending, Signals(), refine=False) == (True, ["saved"])


def test_a_second_signal_does_not_wait_for_the_smoothing():
    ending, signals = Ending(), Signals()
    signals.count = 1
    threading.Timer(0.3, lambda: signals._take(15, None)).start()
    began_s = time.monotonic()
    done, said = ended(ending, signals)
    ending.gate.set()
    assert not done
    assert time.monotonic() - began_s < 2
    assert "what was saved is whole" in said[-1]
    assert ending.steps[:2] == ["stop", "save"]


def test_what_fails_with_saving_is_said_or_raised():
    ending = Ending()
    ending.gate.set()
    ending.error = MapError("nothing to save")
    assert ended(ending, Signals()) == (True, ["nothing to save", "smoothed"])
    ending.error = ZeroDivisionError("a fault")
    with pytest.raises(ZeroDivisionError):
        ended(ending, Signals())


class Estimation:
    """Stands in for SLAM: what it is given is kept, poses come when a test says so."""

    def __init__(self, camera, known, on_pose):
        self.camera, self.known, self.on_pose = camera, known, on_pose
        self.frames, self.samples, self.error, self.is_closed = [], [], None, False
        self.counts, self.objects = None, Map(())

    def add_imu(self, samples):
        self.samples.append(samples)

    def add_frame(self, image, time_s, frame=None):
        if self.error is not None:
            raise self.error
        self.frames.append((frame, time_s))

    def map(self):
        return self.objects

    def finish(self):
        return None

    def close(self):
        self.is_closed = True


@pytest.fixture
def ros(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    import rclpy

    context = rclpy.Context()
    context.init(args=["meshslam"], domain_id=1 + os.getpid() % 100)
    node = rclpy.create_node("meshslam", context=context)
    node.declare_parameter("map", "")
    yield node, context
    node.destroy_node()
    context.try_shutdown()


class Wired:
    """A node with a stand-in, and what it publishes."""

    def __init__(self, ros, out, **changes):
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from nav_msgs.msg import Odometry
        from rclpy.executors import SingleThreadedExecutor

        self.made, self.odometry, self.poses = [], [], []
        node, context = ros
        self.saving = Saving(out, Config(), "slam", overwrite=False).__enter__()
        body = changes.pop("camera_from_body", None)
        options = NodeOptions(imu="/imu", imu_from_camera="given", out=str(out), **changes)

        def make(camera, known, on_pose):
            self.made.append(Estimation(camera, known, on_pose))
            return self.made[-1]

        camera = CameraFile(Camera(64, 48, 50.0, 50.0, 31.5, 23.5))
        self.node = SlamNode(
            node,
            options,
            make,
            self.saving,
            camera=camera,
            imu_from_camera=(IMU_FROM_CAMERA, 0.0),
            camera_from_body=body,
        )
        node.create_subscription(Odometry, "/meshslam/odometry", self.odometry.append, 10)
        node.create_subscription(PoseWithCovarianceStamped, "/meshslam/pose", self.poses.append, 10)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(node)
        self.begun(1)

    def begun(self, count):
        """Wait until the estimation of this number was made, and is fed."""
        self.until(lambda: len(self.made) == count and self.node._live is self.made[-1])

    def until(self, condition, timeout_s=10.0):
        end_s = time.monotonic() + timeout_s
        while not condition():
            self.executor.spin_once(timeout_sec=0.05)
            assert self.node.fault is None, self.node.fault
            assert time.monotonic() < end_s

    def asked(self, act):
        """What a service's act gives, or raises: the node's housekeeping does it."""
        answers = []

        def job():
            try:
                answers.append(act())
            except MapError as error:
                answers.append(error)

        self.node._jobs.put(job)
        self.until(lambda: answers)
        if isinstance(answers[0], MapError):
            raise answers[0]
        return answers[0]

    def image(self, at_s):
        self.node.inlets._take_image(image_message(np.zeros((48, 64, 3), np.uint8), FIRST_S + at_s))

    def close(self):
        self.node.stop()
        self.node.close()
        self.saving.__exit__(None, None, None)
        self.executor.shutdown()


def live_pose(frame, pose, covariance, map_from_odometry=None):
    velocity = np.array([5.0, 1.0, 0.0])
    moved = map_from_odometry or Pose.identity()
    return LivePose(frame, FIRST_S + 0.1 * frame, pose, covariance, velocity, 0.01, "window", map_from_odometry=moved)


def test_odometry_of_the_body_is_where_the_body_is(ros, tmp_path, rng):
    body = Pose.exp(np.array([0.3, -1.2, 0.5, 1.2, -1.2, 1.2]))
    wired = Wired(ros, tmp_path / "run", camera_from_body=body)
    try:
        half = rng.normal(0, 0.1, (6, 6))
        pose, covariance = Pose.exp(rng.normal(0, 1, 6)), half @ half.T
        for k in range(2):
            wired.image(0.1 * k)
        wired.made[0].on_pose(live_pose(1, pose, covariance))
        wired.until(lambda: wired.odometry)
        told = wired.odometry[0]
        assert (told.header.frame_id, told.child_frame_id) == ("odom", "base_link")
        stamp = image_message(np.zeros((1, 1, 3), np.uint8), FIRST_S + 0.1).header.stamp
        assert told.header.stamp == stamp
        p, q = told.pose.pose.position, told.pose.pose.orientation
        found = Pose.from_quaternion(np.array([q.x, q.y, q.z, q.w]), np.array([p.x, p.y, p.z]), order="xyzw")
        np.testing.assert_allclose(found.matrix, (pose @ body).matrix, atol=1e-12)
        expected = pose_covariance_in_parent(pose @ body, covariance_of_body(covariance, body))
        np.testing.assert_allclose(told.pose.covariance.reshape(6, 6), expected, atol=1e-12)
        v = told.twist.twist.linear
        in_world = found.rotation @ np.array([v.x, v.y, v.z])
        np.testing.assert_allclose(in_world, [5.0, 1.0, 0.0], atol=1e-9)  # nothing turns: the body moves as the IMU
    finally:
        wired.close()


def test_a_closed_loop_moves_the_pose_in_the_map_and_not_the_odometry(ros, tmp_path, rng):
    """REP 105: odom is continuous, map is where the world is; the covariance turns with the axes."""
    wired = Wired(ros, tmp_path / "run")
    try:
        half = rng.normal(0, 0.1, (6, 6))
        in_odometry, covariance = Pose.exp(rng.normal(0, 1, 6)), half @ half.T
        corrected = Pose.from_yaw(0.4, np.array([3.0, -2.0, 0.5]))
        for k in range(3):
            wired.image(0.1 * k)
        wired.made[0].on_pose(live_pose(1, in_odometry, covariance))
        wired.made[0].on_pose(live_pose(2, corrected @ in_odometry, covariance, corrected))
        wired.until(lambda: len(wired.odometry) == 2 and len(wired.poses) == 2)
        for told, expected in zip(wired.odometry, (in_odometry, in_odometry), strict=True):
            assert told.header.frame_id == "odom"
            check_pose(told.pose, expected, covariance)
        for told, expected in zip(wired.poses, (in_odometry, corrected @ in_odometry), strict=True):
            assert told.header.frame_id == "map"
            check_pose(told.pose, expected, covariance)
    finally:
        wired.close()


def check_pose(told, expected, covariance):
    p, q = told.pose.position, told.pose.orientation
    found = Pose.from_quaternion(np.array([q.x, q.y, q.z, q.w]), np.array([p.x, p.y, p.z]), order="xyzw")
    np.testing.assert_allclose(found.matrix, expected.matrix, atol=1e-12)
    turned = pose_covariance_in_parent(expected, covariance)
    np.testing.assert_allclose(told.covariance.reshape(6, 6), turned, atol=1e-12)


def test_an_estimation_that_stopped_is_said_and_begun_anew_by_reset(ros, tmp_path):
    wired = Wired(ros, tmp_path / "run")
    try:
        wired.image(0.0)
        wired.made[0].error = SequenceError("the run has stopped")
        wired.image(0.1)
        assert "the run has stopped: call ~/reset" in wired.node._estimation_problem()
        wired.asked(wired.node._end_live)
        wired.begun(2)
        assert wired.made[0].is_closed
        assert wired.node._estimation_problem() == ""
        wired.image(0.0)  # a clock that was set back
        assert [frame for frame, _ in wired.made[1].frames] == [0]
    finally:
        wired.close()


def test_localizing_takes_the_map_so_far(ros, tmp_path, car):
    wired = Wired(ros, tmp_path / "run")
    try:
        with pytest.raises(MapError, match="no object to localize with"):
            wired.asked(wired.node._localize)
        wired.made[0].objects = Map((car,))
        wired.asked(wired.node._localize)
        wired.begun(2)
        assert (wired.made[0].known, list(wired.made[1].known)) == (None, [car.id])
        wired.asked(wired.node._slam)
        wired.begun(3)
        assert wired.made[2].known is None
    finally:
        wired.close()


def test_saving_needs_a_pose_and_writes_map_and_path(ros, tmp_path, car):
    wired = Wired(ros, tmp_path / "run")
    try:
        with pytest.raises(MapError, match="nothing to save"):
            wired.asked(wired.node.save)
        wired.image(0.0)
        wired.made[0].objects = Map((car,))
        wired.made[0].on_pose(live_pose(0, Pose.identity(), np.eye(6)))
        assert wired.asked(wired.node.save).startswith("saved: 1 objects and 1 poses")
        assert list(Map.load(tmp_path / "run")) == [car.id]
        assert len(Trajectory.load(tmp_path / "run" / "trajectory.tum")) == 1
    finally:
        wired.close()
