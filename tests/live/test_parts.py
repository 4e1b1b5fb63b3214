"""The parts of the live pipeline, each by a law of its own."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.live.filling import filled
from meshslam.live.imu_log import ImuLog
from meshslam.live.workers import InOrder, Newest, Worker
from meshslam.maps import Trajectory, TrajectoryEstimate
from meshslam.motion import ImuConfig
from meshslam.sequences import ImuSamples
from tests.fixtures.imu_street import IMU_FROM_CAMERA, errors_m


def samples(times_s, force=9.81):
    count = len(times_s)
    return ImuSamples(np.array(times_s, float), np.zeros((count, 3)), np.tile([0.0, 0.0, force], (count, 1)))


def test_samples_are_sorted_and_each_time_counts_once():
    log = ImuLog()
    assert log.add(samples([0.0, 0.1, 0.3])) == 0
    assert log.add(samples([0.2, 0.1, 0.4])) == 1
    assert log.between(-1.0, 1.0).times_s.tolist() == [0.0, 0.1, 0.2, 0.3, 0.4]
    assert log.between(0.1, 0.3).times_s.tolist() == [0.2, 0.3]
    assert log.newest(2).times_s.tolist() == [0.3, 0.4]


def test_what_no_vehicle_makes_and_what_is_no_number_is_left_out():
    log = ImuLog()
    broken = samples([0.0, 0.1, 0.2])
    broken.specific_force_m_s2[1] = 1e4
    broken.angular_rate_rad_s[2] = np.nan
    assert log.add(broken) == 2
    assert log.between(-1.0, 1.0).times_s.tolist() == [0.0]


def test_many_samples_are_kept():
    log = ImuLog()
    for begin in range(0, 20_000, 1000):
        log.add(samples(np.arange(begin, begin + 1000) * 0.01))
    assert np.array_equal(log.between(-1.0, 1e9).times_s, np.arange(20_000) * 0.01)


def test_waiting_for_samples_ends_when_they_come_or_patience_does():
    log = ImuLog()
    began_s = time.monotonic()
    assert not log.wait_for(1.0, 0.05)
    assert time.monotonic() - began_s >= 0.05
    threading.Timer(0.05, lambda: log.add(samples([1.0]))).start()
    assert log.wait_for(1.0, 30.0)


def test_a_newer_thing_takes_the_place_of_one_that_nobody_fetched():
    place = Newest()
    for thing in range(5):
        place.put(thing)
    place.close()
    assert place.get() == 4
    assert place.get() is None


def test_a_worker_does_all_in_order_and_what_it_raises_is_told():
    done, told, queue = [], [], InOrder()
    worker = Worker("test", queue, lambda thing: done.append(1 / thing), told.append)
    for thing in (1.0, 2.0, 0.0, 4.0):
        queue.put(thing)
    worker.finish()
    assert done == [1.0, 0.5]
    assert [type(error) for error in told] == [ZeroDivisionError]


@pytest.fixture
def estimate(drive, street):
    times, poses = street.times_s, street.world_from_camera
    velocity = np.gradient(np.array([pose.translation for pose in poses]), times, axis=0)
    count = len(times)
    whole = TrajectoryEstimate(
        Trajectory(times, tuple(poses)),
        drive.frame_ids,
        np.tile(1e-4 * np.eye(6), (count, 1, 1)),
        velocity,
        np.tile([0.08, -0.05, 0.05, 1e-3, -1e-3, 1e-3], (count, 1)),
        ("images",) * count,
        np.zeros(count, bool),
    )
    return whole


def part(estimate, rows):
    return TrajectoryEstimate(
        Trajectory(estimate.trajectory.times_s[rows], tuple(estimate.trajectory.world_from_camera[r] for r in rows)),
        tuple(estimate.frame_ids[r] for r in rows),
        estimate.covariances[rows],
        estimate.velocity_in_world[rows],
        estimate.biases[rows],
        tuple(estimate.sources[r] for r in rows),
        estimate.extrapolated[rows],
    )


def test_frames_that_were_skipped_follow_from_the_imu(drive, estimate):
    rows = [0, 1, 4, 5, 10, 11]  # the last four are behind all that was taken in
    frames = list(zip(drive.frame_ids, drive.times_s.tolist(), strict=True))
    found = filled(part(estimate, rows), frames, drive.imu.between, IMU_FROM_CAMERA, ImuConfig())
    assert found.frame_ids == drive.frame_ids
    errors = errors_m(found.trajectory.world_from_camera, estimate.trajectory.world_from_camera)
    assert errors[rows].max() == 0.0
    assert errors[:12].max() < 0.01  # a straight line between the frames is off by 0.03 m
    assert errors.max() < 0.06
    assert found.sources == tuple("images" if f in rows else "imu" for f in drive.frame_ids)
    assert found.extrapolated.tolist() == [f not in rows for f in drive.frame_ids]
    assert np.allclose(found.velocity_in_world[1:12], estimate.velocity_in_world[1:12], atol=0.4)


def test_frames_before_the_first_that_was_taken_in_are_left_out(drive, estimate):
    frames = list(zip(drive.frame_ids, drive.times_s.tolist(), strict=True))
    found = filled(part(estimate, [3, 4]), frames, drive.imu.between, IMU_FROM_CAMERA, ImuConfig())
    assert found.frame_ids == drive.frame_ids[3:]


def test_without_any_sample_the_path_goes_straight_on(drive, estimate):
    frames = list(zip(drive.frame_ids, drive.times_s.tolist(), strict=True))
    nothing = ImuSamples(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    few = replace(part(estimate, [0, 2]), biases=None)
    found = filled(few, frames[:4], lambda *_: nothing, IMU_FROM_CAMERA, ImuConfig())
    errors = errors_m(found.trajectory.world_from_camera, estimate.trajectory.world_from_camera[:4])
    assert errors.max() < 0.15


def test_an_estimate_moved_to_another_world_keeps_what_is_along_own_axes(estimate):
    turn = Pose.from_quaternion([0.5, 0.5, 0.5, 0.5], [1.0, 2.0, 3.0], order="xyzw")
    moved = estimate.moved(turn)
    assert np.allclose(
        moved.trajectory.world_from_camera[3].matrix, (turn @ estimate.trajectory.world_from_camera[3]).matrix
    )
    assert np.allclose(moved.velocity_in_world[3], turn.rotation @ estimate.velocity_in_world[3])
    assert moved.covariances is estimate.covariances
    back = moved.moved(turn.inverse())
    assert np.allclose(back.velocity_in_world, estimate.velocity_in_world)
