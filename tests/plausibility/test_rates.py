"""Rates of an IMU on level ground: gravity does not turn, what is seen and known poses do."""

import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.geometry import Camera, Pose, exp_so3
from meshslam.localization.stream import Stream
from meshslam.plausibility import RatesBySight, judge_imu, judge_rates_by_poses, judge_rates_by_sight
from meshslam.sequences import ImuSamples

CAMERA = Camera(560, 180, 330.0, 330.0, 280.0, 90.0)
IMU_FROM_CAMERA = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))
FRAME_S, RATE_HZ = 0.1, 100


def yaw(times_s, rate):
    """Of a vehicle that weaves: the heading at times, and its rate."""
    return rate * np.sin(times_s), rate * np.cos(times_s)


def drive(rate=0.05, unit=1.0, frames=60, noise=1e-3, seed=0):
    """Level samples, poses and pictures of still points around a vehicle that goes on at 5 m/s."""
    rng = np.random.default_rng(seed)
    times_s = np.arange(int(frames * FRAME_S * RATE_HZ)) / RATE_HZ
    rates = np.stack([0 * times_s, 0 * times_s, yaw(times_s, rate)[1]], 1) + rng.normal(0, noise, (len(times_s), 3))
    forces = np.tile([0.0, 0.0, 9.81], (len(times_s), 1)) + rng.normal(0, 0.4, (len(times_s), 3))
    frame_s = FRAME_S * np.arange(frames)
    turned = [exp_so3(np.array([0.0, 0.0, angle])) for angle in yaw(frame_s, rate)[0]]
    poses = [Pose(r, np.array([5.0 * t, 0.0, 0.0])) @ IMU_FROM_CAMERA for r, t in zip(turned, frame_s, strict=True)]
    angles = np.linspace(0, 2 * np.pi, 40)
    things = np.stack([30 * np.cos(angles) + 15, 30 * np.sin(angles), -1 + 0 * angles], 1)
    return ImuSamples(times_s, rates * unit, forces), poses, [(t, seen(p, things)) for t, p in zip(frame_s, poses)]  # noqa: B905


def seen(pose, things):
    inside = pose.inverse().transform(things)
    inside = inside[inside[:, 2] > 2]
    pixels = CAMERA.project(inside)
    return pixels[(pixels[:, 0] > 0) & (pixels[:, 0] < CAMERA.width)]


def codes(findings):
    return [finding.code for finding in findings]


@pytest.mark.parametrize("rate", [0.03, 0.1, 0.3])
@pytest.mark.parametrize("seed", [0, 1])
def test_degrees_are_seen_although_gravity_does_not_turn(rate, seed):
    imu, poses, pictures = drive(rate, 180 / np.pi, seed=seed)
    assert codes(judge_imu(imu, "imu")) == []
    assert codes(judge_rates_by_sight(CAMERA, imu, IMU_FROM_CAMERA, pictures, "imu")) == ["imu_in_degrees"]
    frame_s = np.array([t for t, _ in pictures])
    assert codes(judge_rates_by_poses(imu, IMU_FROM_CAMERA, frame_s, poses, "imu")) == ["imu_in_degrees"]


@pytest.mark.parametrize("rate", [0.0, 0.03, 0.3, 1.0, 2.5])
def test_radians_are_right_however_fast_the_camera_turns(rate):
    imu, poses, pictures = drive(rate)
    assert judge_rates_by_sight(CAMERA, imu, IMU_FROM_CAMERA, pictures, "imu") == []
    frame_s = np.array([t for t, _ in pictures])
    assert judge_rates_by_poses(imu, IMU_FROM_CAMERA, frame_s, poses, "imu") == []


def test_turned_signs_are_noted_where_poses_are_known():
    imu, poses, pictures = drive(0.3, -1.0)
    frame_s = np.array([t for t, _ in pictures])
    found = judge_rates_by_poses(imu, IMU_FROM_CAMERA, frame_s, poses, "imu")
    assert [(f.code, f.severity) for f in found] == [("imu_turns", "note")]
    assert found[0].figures["agreement"] == pytest.approx(-1.0, abs=0.05)


def test_gaps_and_pictures_without_objects_tell_nothing():
    imu, _, pictures = drive(0.3, 180 / np.pi)
    empty = [(t, np.zeros((0, 2))) for t, _ in pictures]
    assert judge_rates_by_sight(CAMERA, imu, IMU_FROM_CAMERA, empty, "imu") == []
    gap = ImuSamples(imu.times_s + 100.0, imu.angular_rate_rad_s, imu.specific_force_m_s2)
    assert judge_rates_by_sight(CAMERA, gap, IMU_FROM_CAMERA, pictures, "imu") == []


class Seen:
    def __init__(self, pixel):
        self.bbox = (*pixel, 0.0, 0.0)


def test_a_stream_ends_within_seconds_and_a_right_one_stops_looking():
    for unit, right in ((180 / np.pi, False), (1.0, True)):
        imu, _, pictures = drive(0.3, unit)
        stream = Stream(sight=RatesBySight(CAMERA, IMU_FROM_CAMERA))
        ended = None
        for number, (time_s, pixels) in enumerate(pictures):
            stream.take(number, time_s, imu.between(time_s - FRAME_S, time_s) if number else None)
            try:
                stream.see(number, time_s, [Seen(p) for p in pixels])
            except SequenceError as error:
                ended, said = number, str(error)
                break
        assert (ended is None) == right
        if not right:
            assert ended <= 16
            assert "degrees a second" in said
            assert f"frame {ended}" in said
