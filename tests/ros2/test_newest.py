"""Estimation in a thread of its own that takes the newest frame."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject, TiledMap
from meshslam.ros2.newest import NewestFrame
from meshslam.sequences import ImuSamples

IMAGE = np.zeros((2, 3, 3), np.uint8)


def samples(*times_s):
    return ImuSamples(np.array(times_s), np.zeros((len(times_s), 3)), np.zeros((len(times_s), 3)))


class Estimator:
    """Takes so long a frame, and keeps what it was given."""

    def __init__(self):
        self.given, self.gate, self.is_busy = [], threading.Semaphore(0), threading.Event()
        self.error = None

    def process(self, *, image, time_s, frame, imu=None):
        self.given.append((frame, time_s, None if imu is None else imu.times_s.tolist()))
        self.is_busy.set()
        assert self.gate.acquire(timeout=10)
        if self.error is not None:
            raise self.error
        pose = Pose(np.eye(3), np.array([time_s, 0, 0]))
        return SimpleNamespace(
            world_from_camera=pose, camera_covariance=np.eye(6), velocity_in_world=np.zeros(3), objects=(3,), notes=()
        )


@pytest.fixture
def live():
    estimator, poses = Estimator(), []
    made = NewestFrame(estimator, Map(()), on_pose=poses.append, has_imu=True)
    yield made, estimator, poses
    for _ in range(100):
        estimator.gate.release()
    made.close()


def test_the_newest_frame_is_taken_and_others_are_counted(live):
    made, estimator, poses = live
    made.add_imu(samples(0.0, 0.1, 0.2, 0.3, 0.4, 0.5))
    made.add_frame(IMAGE, 0.1, 0)
    assert estimator.is_busy.wait(5)
    for k in range(1, 5):
        made.add_frame(IMAGE, 0.1 + 0.1 * k, k)
    estimator.gate.release()
    estimator.gate.release()
    made.finish()
    assert [frame for frame, _, _ in estimator.given] == [0, 4]
    assert (made.counts.frames, made.counts.skipped, made.counts.poses) == (5, 3, 2)
    assert [pose.frame for pose in poses] == [0, 4]
    assert poses[1].by == "window"


def test_every_sample_goes_once_to_the_first_frame_after_it(live):
    made, estimator, _ = live
    for _ in range(9):
        estimator.gate.release()
    for k in range(1, 5):
        for t in (k - 0.9, k - 0.5, k + 0.01):  # the last is after the frame
            made.add_imu(samples(float(t)))
        made.add_frame(IMAGE, float(k), k)
        made.finish()
    given = [times for _, _, times in estimator.given]
    assert all(max(times) <= time_s for _, time_s, times in estimator.given)
    assert len(np.unique(np.concatenate(given))) == sum(map(len, given)) == 11


def test_a_frame_waits_for_its_samples_but_not_for_ever(live):
    made, estimator, _ = live
    estimator.gate.release()
    made.add_frame(IMAGE, 1.0, 0)
    assert not estimator.is_busy.wait(0.05)
    made.add_imu(samples(0.9, 1.0))
    assert estimator.is_busy.wait(0.15)
    estimator.is_busy.clear()
    estimator.gate.release()
    began_s = time.monotonic()
    made.add_frame(IMAGE, 2.0, 1)
    assert estimator.is_busy.wait(2)
    assert 0.2 < time.monotonic() - began_s < 1.5


def test_an_error_is_told_and_the_next_frame_goes_on(live):
    made, estimator, poses = live
    made.add_imu(samples(0.0, 5.0))
    estimator.error = SequenceError("frame 0: wrong")
    estimator.gate.release()
    made.add_frame(IMAGE, 1.0, 0)
    made.finish()
    estimator.error = None
    estimator.gate.release()
    made.add_frame(IMAGE, 2.0, 1)
    made.finish()
    assert [(pose.by, pose.notes) for pose in poses] == [("waiting", ("frame 0: wrong",)), ("window", ())]
    assert made.counts.refused == 1


def test_adding_never_waits(live):
    made, estimator, _ = live
    made.add_imu(samples(9.0))
    made.add_frame(IMAGE, 1.0, 0)
    assert estimator.is_busy.wait(5)
    began_s = time.monotonic()
    for k in range(2000):
        made.add_imu(samples(10.0 + k))
        made.add_frame(IMAGE, 2.0 + k, k + 1)
    assert time.monotonic() - began_s < 1.0


def test_of_a_map_in_tiles_what_is_around_the_camera_is_shown(tmp_path):
    car = load_category("car")
    city = TiledMap.create(tmp_path / "city")
    city.put(
        MapObject(i, "car", Pose.from_yaw(0.0, np.array([40.0 * i, 0.0, 0.7])), car.vertices, car.faces)
        for i in range(12)
    )
    estimator, poses = Estimator(), []
    made = NewestFrame(estimator, city, on_pose=poses.append, has_imu=False)
    assert len(made.map()) == 0  # before there is a pose
    estimator.gate.release()
    made.add_frame(IMAGE, 200.0, 0)  # the camera is at x = 200 m
    made.finish()
    assert set(made.map()) == {4, 5, 6}
    made.close()
