"""A run of SLAM that is read back is the run that was saved."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.geometry import Pose
from meshslam.motion import Mounting
from meshslam.object_slam import SlamConfig, SlamEstimator
from meshslam.object_slam.archive import estimator_from_arrays, estimator_to_arrays
from meshslam.object_slam.landmarks import Landmark
from meshslam.object_slam.setup import SlamSetup
from tests.fixtures.equality import same
from tests.fixtures.imu_street import IMU_FROM_CAMERA, start_of


@pytest.fixture(scope="module")
def setup(drive, seen):
    car, slam = load_category("car"), SlamConfig(min_baseline_m=2.0, lag_s=0.6)
    return SlamSetup(drive.camera, car, seen.keypoint_names("car"), Mounting(IMU_FROM_CAMERA), 1.65, slam)


@pytest.fixture(scope="module")
def estimator(setup, drive, seen):
    """A run in its middle that has something of everything: also loops that were closed, and moving cars."""
    made, by_frame = SlamEstimator(setup), seen.by_frame()
    made.begin(0, start_of(drive), drive.imu, by_frame[0])
    for index in range(1, 10):
        made.process(index, float(drive.times_s[index]), drive.imu, by_frame[index])
    mark = next(iter(made.landmarks.values()))
    gone = {"in_map": Pose.from_yaw(0.3, np.array([1.0, 2.0, 3.0])), "pose_covariance": np.diag(np.arange(1.0, 7.0))}
    for track in (501, 502):
        number = len(made.landmarks) + 1
        made.landmarks[number] = replace(mark, number=number, track=track, moves=track == 502, **gone)
    made.joined = [(2, 1), (len(made.landmarks), 2)]
    made.moving |= {31, 502}
    made.odometry_frame.map_from_odometry = Pose.from_yaw(0.1, np.array([0.4, 0.2, 0.1]))
    made.odometry_frame.closed_at_m = 3.25
    assert made.candidates
    assert made.in_view
    return made


@pytest.fixture(scope="module")
def read_back(setup, estimator):
    other = SlamEstimator(setup)
    estimator_from_arrays(other, estimator_to_arrays(estimator))
    return other


@pytest.mark.parametrize("what", ["frame_ids", "times_s", "in_view", "moving", "joined"])
def test_what_the_run_knows_is_restored(estimator, read_back, what):
    assert getattr(estimator, what)
    assert getattr(read_back, what) == getattr(estimator, what)


def test_landmarks_that_are_one_stay_one(estimator, read_back):
    assert read_back.joined == estimator.joined
    assert all(isinstance(pair, tuple) for pair in read_back.joined)


def test_the_path_and_the_odometrys_world_are_restored(estimator, read_back):
    assert all(same(estimator.path[f], read_back.path[f]) for f in estimator.frame_ids)
    for name in ("map_from_odometry", "distance_m", "closed_at_m"):
        assert same(getattr(estimator.odometry_frame, name), getattr(read_back.odometry_frame, name))


def test_every_field_of_every_landmark_is_restored(estimator, read_back):
    assert list(read_back.landmarks) == list(estimator.landmarks)
    for number, mark in estimator.landmarks.items():
        for field in fields(Landmark):
            assert same(getattr(mark, field.name), getattr(read_back.landmarks[number], field.name)), field.name


def test_candidates_keep_their_observations(estimator, read_back):
    assert list(read_back.candidates) == list(estimator.candidates)
    for track, candidate in estimator.candidates.items():
        other = read_back.candidates[track]
        assert other.next_try == candidate.next_try
        for one, two in zip(candidate.observations, other.observations, strict=True):
            assert one.index == two.index
            assert np.array_equal(one.occluder, two.occluder)
            assert np.array_equal(one.detection.mask(), two.detection.mask())
            assert np.array_equal(one.detection.keypoints, two.detection.keypoints)


def test_what_was_read_back_is_saved_as_the_same(estimator, read_back):
    one, other = estimator_to_arrays(estimator), estimator_to_arrays(read_back)
    assert one.keys() == other.keys()
    assert same(json.loads(str(one.pop("plain"))), json.loads(str(other.pop("plain"))))
    for name, values in one.items():
        assert np.asarray(other[name]) == pytest.approx(np.asarray(values), rel=1e-9, abs=1e-9), name
