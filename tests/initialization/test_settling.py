import dataclasses

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import SequenceError
from meshslam.geometry import Pose, exp_so3
from meshslam.graph import StartConfig
from meshslam.initialization import FirstFrames, settled
from meshslam.initialization.box_start import standing_rate
from meshslam.initialization.config import UnknownStartConfig
from meshslam.initialization.world_alignment import level_from_world, world_from_levelled
from meshslam.motion import NavState
from meshslam.object_slam import SlamConfig, slam_sequence
from meshslam.object_slam.estimator import SlamEstimator
from meshslam.runs import Config
from meshslam.sequences import ImuSamples
from tests.fixtures.imu_street import IMU_FROM_CAMERA, errors_m, localized, slammed


@pytest.fixture(scope="module")
def unaware(drive):
    """The drive of a recording that does not say how it starts."""
    return dataclasses.replace(drive, initial_state=None)


@pytest.fixture(scope="module")
def freely(unaware, seen):
    return slammed(unaware, seen)


def test_slam_finds_speed_and_gravity(freely, street):
    truth = street.world_from_camera
    steps = [
        np.linalg.norm(np.diff([p.translation for p in path], axis=0), axis=1).sum()
        for path in (freely.trajectory.world_from_camera, truth)
    ]
    assert steps[0] == pytest.approx(steps[1], rel=0.05)
    ups = [p.rotation.T @ [0.0, 0.0, 1.0] for p in (freely.trajectory.world_from_camera[0], truth[0])]
    assert np.degrees(np.arccos(ups[0] @ ups[1])) < 1.5
    assert np.allclose(freely.trajectory.world_from_camera[0].translation, 0, atol=0.1)


def test_slam_goes_on_with_the_run_that_settled(unaware, seen, monkeypatch):
    """No frame is estimated again once the start stays where it is."""
    begun, told = [], []

    def counted(self, *given):
        begun.append(given[0])
        return begin(self, *given)

    begin = SlamEstimator.begin
    monkeypatch.setattr(SlamEstimator, "begin", counted)
    settings = Config(slam=SlamConfig(min_baseline_m=2.0))
    slam_sequence(unaware, seen, load_category("car"), settings, lambda *said: told.append(said))
    rounds = max(done for step, done, _ in told if step == "start")
    assert 1 < rounds < 4
    assert len(begun) == rounds


@pytest.mark.parametrize("ids", [True, False])
def test_localize_finds_its_place_in_the_map(unaware, seen, scene, street, ids):
    found = seen if ids else seen.with_tracks({d.id: None for d in seen.detections})
    path = localized(unaware, found, scene).world_from_camera
    assert errors_m(path, street.world_from_camera).max() < 0.15


def test_without_objects_the_message_says_what_to_do(unaware, seen, scene):
    nothing = dataclasses.replace(seen, detections=())
    with pytest.raises(SequenceError, match=r"no start: there is no initial_state.yaml, and no object is seen"):
        localized(unaware, nothing, scene)


def test_the_first_known_pose_says_where_the_world_is(unaware):
    rng = np.random.default_rng(2)
    level_camera = IMU_FROM_CAMERA.rotation  # looks along x
    first = Pose(level_camera @ exp_so3(rng.normal(0, 0.02, 3)), rng.normal(size=3))
    known = Pose(exp_so3(np.array([0.01, -0.02, 0.8])) @ level_camera, np.array([5.0, 6.0, 7.0]))
    levelled = dataclasses.replace(unaware, world_from_camera=(known,) * len(unaware))
    tilted = dataclasses.replace(levelled, is_levelled=False)
    moved = world_from_levelled(levelled, first)
    assert np.allclose(moved.rotation[2], [0, 0, 1])  # z stays up
    assert np.allclose(moved.transform(first.translation), known.translation)
    assert np.allclose((world_from_levelled(tilted, first) @ first).matrix, known.matrix)
    assert np.allclose(world_from_levelled(unaware, first).matrix, np.eye(4))


def test_a_world_of_known_poses_is_levelled_by_the_imu(drive, street):
    tilt = Pose(exp_so3(np.array([0.03, -0.02, 0.0])), np.zeros(3))
    poses = tuple(tilt @ p for p in street.world_from_camera)
    tilted = dataclasses.replace(drive, world_from_camera=poses, is_levelled=False)
    level = level_from_world(tilted, drive.imu, IMU_FROM_CAMERA)
    up = (level @ tilt).rotation @ [0.0, 0.0, 1.0]
    assert np.degrees(np.arccos(up[2])) < 0.7
    joined = dataclasses.replace(tilted, is_levelled=True)
    assert np.allclose(level_from_world(joined, drive.imu, IMU_FROM_CAMERA).matrix, np.eye(4))


def test_a_gyroscope_that_stands_still_shows_its_bias():
    rng = np.random.default_rng(4)
    times, bias = np.arange(0, 2, 0.01), np.array([0.004, -0.003, 0.002])
    still = ImuSamples(times, bias + rng.normal(0, 1e-3, (200, 3)), [0, 0, 9.81] + rng.normal(0, 0.02, (200, 3)))
    assert np.allclose(standing_rate(still, times), bias, atol=5e-4)
    driving = dataclasses.replace(still, specific_force_m_s2=still.specific_force_m_s2 + rng.normal(0, 0.5, (200, 3)))
    assert np.allclose(standing_rate(driving, times), 0)


class _Still:
    """An estimator whose first state is moved by a share of what is left, each time that it is run."""

    def __init__(self, truth_m_s, share):
        self.truth_m_s, self.share, self.frames = truth_m_s, share, []

    def begin(self, frame, state, imu, detections):
        self.state = state
        self.frames.append(frame)
        return frame

    def process(self, frame, time_s, imu, detections):
        self.frames.append(frame)
        return frame

    def first_state(self):
        velocity = self.state.velocity_in_world
        moved = velocity + self.share * (np.array([self.truth_m_s, 0.0, 0.0]) - velocity)
        return dataclasses.replace(self.state, velocity_in_world=moved)


@pytest.mark.parametrize(("share", "rounds"), [(1.0, 2), (0.5, 4), (0.0, 1)])
def test_rounds_end_when_the_start_moves_by_a_tenth_of_its_sigma_and_the_last_run_is_kept(share, rounds):
    made = []

    def fresh():
        made.append(_Still(10.0, share))
        return made[-1]

    frames = FirstFrames(None, tuple(range(50)), np.arange(50) * 0.1, None, "made up")
    zero = np.zeros(3)
    begun = NavState(0.0, Pose.identity(), np.array([9.0, 0.0, 0.0]), zero, zero)
    start, config = StartConfig(velocity_sigma_m_s=1.0), UnknownStartConfig(max_settling_rounds=8)
    found = settled(frames, None, {}, begun, fresh, start, config, 10.0)
    assert len(made) == rounds
    assert found.estimator is made[-1]
    assert list(found.reports) == made[-1].frames
    assert len(made[-1].frames) == 31
    assert abs(found.state.velocity_in_world[0] - 10.0) <= (0.1 if share else 1.0)


def test_a_start_that_does_not_settle_leaves_no_run():
    frames = FirstFrames(None, tuple(range(50)), np.arange(50) * 0.1, None, "made up")
    zero = np.zeros(3)
    begun = NavState(0.0, Pose.identity(), np.array([0.0, 0.0, 0.0]), zero, zero)
    start, config = StartConfig(velocity_sigma_m_s=1.0), UnknownStartConfig(max_settling_rounds=2)
    found = settled(frames, None, {}, begun, lambda: _Still(10.0, 0.3), start, config, 10.0)
    assert found.estimator is None
    assert found.state.velocity_in_world[0] == pytest.approx(5.1)
