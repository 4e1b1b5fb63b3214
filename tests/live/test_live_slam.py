"""SLAM beside a camera that does not wait: every frame has a pose in time, and what is late or broken is counted."""

import time
from dataclasses import replace

import numpy as np
import pytest

from meshslam.errors import GeometryError, SequenceError
from meshslam.live import LiveConfig, LiveSlam, replay
from meshslam.object_slam import SlamConfig
from meshslam.runs import Config
from tests.fixtures.imu_street import SOON, errors_m, slammed

CONFIG = Config(slam=SlamConfig(min_baseline_m=2.0))
PATIENT = LiveConfig(deadline_s=20.0, pending_frames=50, imu_wait_s=5.0)


@pytest.fixture
def begin(drive):
    """Make a live run that is ended with the test."""
    runs = []

    def make(live=PATIENT, **told):
        poses = []
        given = {"start": drive.initial_state, "config": CONFIG, "height_above_ground_m": 1.65, "on_pose": poses.append}
        run = LiveSlam(drive.camera, imu_from_camera=drive.imu_from_camera, live=live, **(given | told))
        run.poses = poses
        runs.append(run)
        return run

    yield make
    for run in runs:
        run.close()


def feed(run, drive, by_frame, frames, *, imu=True):
    """Give each frame when the one before was taken in and looked at."""
    counts = run.counts
    for frame in frames:
        time_s = float(drive.times_s[frame])
        before_s = float(drive.times_s[frame - 1]) + 0.011 if frame else -1.0
        if imu:
            run.add_imu(drive.imu.between(before_s, time_s + 0.011))
        looked_at, skipped = counts.segmented + counts.perceptions_failed, counts.skipped
        run.add_frame(None, time_s, frame, detections=by_frame[frame])
        looked_at += counts.skipped == skipped
        until_s = time.monotonic() + 20
        while time.monotonic() < until_s:
            done = counts.taken_in + counts.failed + counts.skipped
            if done == counts.frames and counts.segmented + counts.perceptions_failed >= looked_at:
                break
            time.sleep(0.001)


def test_with_time_enough_it_is_as_good_as_the_stream(begin, drive, seen, street):
    run = begin()
    feed(run, drive, seen.by_frame(), range(len(drive)))
    result = run.finish()
    assert [pose.frame for pose in run.poses] == list(drive.frame_ids)
    assert {pose.by for pose in run.poses} == {"window"}
    assert (run.counts.taken_in, run.counts.skipped, run.counts.failed) == (len(drive), 0, 0)
    assert run.counts.segmented == len(drive)
    stream = slammed(drive, seen)
    live, offline = (
        errors_m(p, street.world_from_camera)
        for p in (result.trajectory.world_from_camera, stream.trajectory.world_from_camera)
    )
    assert live.max() < 1.5 * offline.max() + 0.02
    assert len(result.map) >= len(stream.map) - 1
    assert result.estimate.frame_ids == drive.frame_ids


def test_detections_that_come_while_the_window_has_their_frame_are_used_with_the_next(begin, drive, seen):
    """The network ends with a frame in the middle of the window's work on it."""
    run, by_frame, given = begin(), seen.by_frame(), {}
    process = run._slam.process_live

    def process_slowly(frame, samples, features, late):
        given.update(late)
        if frame.detections is not None:
            given[frame.number] = frame.detections
        state = process(frame, samples, features, late)
        with run._news:
            run._late[frame.number] = by_frame[frame.number]  # as the thread of the network puts them
        return state

    run._slam.process_live = process_slowly
    run._segment = lambda _frame: None
    for frame in range(6):
        time_s = float(drive.times_s[frame])
        before_s = float(drive.times_s[frame - 1]) + 0.011 if frame else -1.0
        run.add_imu(drive.imu.between(before_s, time_s + 0.011))
        run.add_frame(None, time_s, frame)
        until_s = time.monotonic() + 20
        while run.counts.taken_in <= frame and time.monotonic() < until_s:
            time.sleep(0.001)
    assert run.counts.taken_in == 6
    assert set(given) == set(range(5))  # each with the frame after it
    assert all(given[frame] == by_frame[frame] for frame in given)


def test_a_pose_comes_in_time_whatever_the_window_does(begin, drive, seen, street):
    run = begin(LiveConfig(deadline_s=0.02))
    by_frame = seen.by_frame()
    feed(run, drive, by_frame, range(12))
    with run._lock:  # a window that takes long
        began_s = time.monotonic()
        for frame in range(12, len(drive)):
            run.add_imu(drive.imu.between(float(drive.times_s[frame - 1]) + 0.011, float(drive.times_s[frame]) + 0.011))
            run.add_frame(None, float(drive.times_s[frame]), frame, detections=by_frame[frame])
        assert time.monotonic() - began_s < 0.5  # nothing waits
        while len(run.poses) < len(drive) and time.monotonic() - began_s < 20:
            time.sleep(0.002)
    late = run.poses[12:]
    assert {pose.by for pose in late} == {"imu"}
    assert run.counts.skipped > 0
    truth = street.world_from_camera
    assert errors_m([pose.world_from_camera for pose in late], truth[12:]).max() < 0.25
    assert np.trace(late[-1].covariance) > np.trace(late[0].covariance)
    result = run.finish()
    assert len(result.trajectory) == len(drive)
    assert errors_m(result.trajectory.world_from_camera, truth).max() < 0.2


def test_detections_that_come_late_are_put_into_their_own_frame(begin, drive, seen):
    run = begin()
    by_frame = seen.by_frame()
    held = {}
    process = run._perception.process

    def slow(number, image, detections):
        held[number] = process(number, image, detections)
        return ()

    run._perception.process = slow
    for frame in range(len(drive)):
        feed(run, drive, by_frame, [frame])
        if frame >= 3:
            while frame - 3 not in held:
                time.sleep(0.001)
            run._late[frame - 3] = held[frame - 3]
    run._late.update({frame: held[frame] for frame in range(len(drive) - 3, len(drive)) if frame in held})
    result = run.finish()
    assert run.counts.too_late == 0
    assert len(result.map) >= 3
    tags = {tag.frame for _, tag in run._slam._estimator.smoother.objects.observations()}
    assert len(tags) > 8


def test_without_a_start_frames_wait_and_then_have_poses(begin, drive, seen):
    run = begin(start=None, config=SOON, live=LiveConfig(deadline_s=20.0, pending_frames=50, start_step_s=0.0))
    feed(run, drive, seen.by_frame(), range(len(drive)))
    run.close()
    waiting = [pose.frame for pose in run.poses if pose.by == "waiting"]
    assert waiting == list(range(len(waiting)))
    assert 8 <= len(waiting) <= 12
    assert run.counts.waiting == len(waiting)
    assert 0.9 < run.counts.start_drive_s < 1.3
    assert run.counts.start_work_s > 0


def test_a_start_that_is_not_found_is_searched_again(begin, drive, seen):
    run = begin(start=None, config=SOON, live=LiveConfig(deadline_s=20.0, pending_frames=50, start_step_s=0.0))
    feed(run, drive, dict.fromkeys(drive.frame_ids, ()), range(len(drive)))  # no car at all
    run.close()
    assert run.counts.starts_failed >= 1
    notes = [note for pose in run.poses for note in pose.notes]
    assert any("no start" in note and "begins anew" in note for note in notes)
    with pytest.raises(SequenceError, match="no start"):
        run.finish()


def test_broken_detections_are_counted_and_the_run_goes_on(begin, drive, seen):
    run = begin()
    by_frame = seen.by_frame()
    by_frame[5] = [object()]
    feed(run, drive, by_frame, range(len(drive)))
    run.close()
    assert run.counts.perceptions_failed == 1
    assert run.counts.segmented == len(drive) - 1
    assert any("frame 5" in note for pose in run.poses for note in pose.notes)
    assert run.poses[-1].by == "window"


def test_an_imu_that_pauses_is_told(begin, drive, seen):
    run = begin(LiveConfig(deadline_s=0.02, imu_wait_s=0.0))
    by_frame = seen.by_frame()
    feed(run, drive, by_frame, range(8))
    with run._lock:
        for frame in range(8, 14):
            run.add_frame(None, float(drive.times_s[frame]), frame, detections=by_frame[frame])
        until_s = time.monotonic() + 20
        while len(run.poses) < 14 and time.monotonic() < until_s:
            time.sleep(0.002)
    assert any("samples are missing" in note for pose in run.poses[8:] for note in pose.notes)
    run.add_imu(drive.imu.between(float(drive.times_s[7]) + 0.011, 10.0))
    feed(run, drive, by_frame, [14, 15], imu=False)
    assert len(run.finish().trajectory) == len(drive)


def test_an_imu_on_another_clock_is_named(begin, drive, seen):
    run = begin(LiveConfig(deadline_s=1.0, imu_wait_s=0.01))
    shifted = drive.imu.between(-1.0, 1.0)
    run.add_imu(type(shifted)(shifted.times_s + 1e6, shifted.angular_rate_rad_s, shifted.specific_force_m_s2))
    feed(run, drive, seen.by_frame(), range(3), imu=False)
    run.close()
    assert any("another clock" in note for pose in run.poses for note in pose.notes)


def test_wrong_calls_are_refused_and_change_nothing(begin, drive, seen):
    run = begin()
    feed(run, drive, seen.by_frame(), range(3))
    with pytest.raises(SequenceError, match="must go on"):
        run.add_frame(None, 0.0, 3, detections=())
    with pytest.raises(SequenceError, match="must go on"):
        run.add_frame(None, float("nan"), 3, detections=())
    with pytest.raises(SequenceError, match="with every frame or with none"):
        run.add_frame(np.zeros((180, 560, 3), np.uint8), 0.3, 3)
    with pytest.raises(SequenceError, match="expected ImuSamples"):
        run.add_imu([1.0, 2.0])
    assert run.counts.frames == 3
    run.close()
    with pytest.raises(SequenceError, match="closed"):
        run.add_frame(None, 0.3, 3, detections=())
    other = begin()
    with pytest.raises(GeometryError, match="uint8"):
        other.add_frame(np.zeros((10, 10, 3), np.uint8), 0.0)


def test_what_a_thread_raises_is_raised_here(begin, drive, seen):
    def full(_):
        raise RuntimeError("the disk is full")

    run = begin(on_pose=full)
    run.add_imu(drive.imu.between(-1.0, 0.02))
    run.add_frame(None, 0.0, 0, detections=())
    until_s = time.monotonic() + 20
    while run._error is None and time.monotonic() < until_s:
        time.sleep(0.002)
    with pytest.raises(SequenceError, match="the disk is full"):
        run.add_frame(None, 0.1, 1, detections=())


def test_a_replay_gives_everything_by_its_clock(begin, drive, seen):
    run = begin(LiveConfig(deadline_s=0.03))
    began_s = time.monotonic()
    replay(drive, run, rate=2.0, detections=seen.by_frame())
    run.close()
    assert time.monotonic() - began_s > 0.5 * (drive.times_s[-1] - drive.times_s[0])
    assert run.counts.frames == len(run.poses) == len(drive)
    told = [pose for pose in run.poses if pose.world_from_camera is not None]
    assert [pose.frame for pose in told] == list(range(len(drive) - len(told), len(drive)))
    assert len(told) >= 5  # a loaded machine's first update takes long
    assert max(pose.latency_s for pose in told) < 1.0


def test_a_start_waits_for_detections_that_come_late(begin, drive, seen):
    run = begin(start=None, config=SOON, live=LiveConfig(deadline_s=20.0, pending_frames=50, start_step_s=0.0))
    by_frame, process = seen.by_frame(), run._slam.process_live

    def held_back(frame, imu, features, late):
        """Nothing of the first second is seen before its end is over."""
        if frame.number <= 11:
            return process(type(frame)(frame.number, frame.time_s, None), imu, features, {})
        early = {number: by_frame[number] for number in range(12)} if frame.number == 12 else late
        return process(frame, imu, features, early)

    run._slam.process_live = held_back
    run._slam._setup = replace(run._slam._setup, slam=replace(run._slam._setup.slam, lag_s=4.0))
    unknown = run._slam._setup.estimation.unknown_start
    patient = replace(run._slam._setup.estimation, unknown_start=replace(unknown, settling_s=1.25))
    run._slam._setup = replace(run._slam._setup, estimation=patient)
    feed(run, drive, by_frame, range(len(drive)))
    run.close()
    assert run.counts.starts_failed == 0
    assert run.poses[-1].world_from_camera is not None
