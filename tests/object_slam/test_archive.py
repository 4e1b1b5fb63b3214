"""A run of SLAM that is read back is the run that was saved."""

from dataclasses import fields, replace

import gtsam
import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.errors import MeshslamError
from meshslam.geometry import Pose
from meshslam.graph.tags import ObservationTag
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
        made.landmarks[number] = replace(
            mark, number=number, track=track, moves=track == 502, is_withdrawn=track == 501, **gone
        )
    made.joined = [(2, 1), (len(made.landmarks), 2)]
    made.moving |= {31, 502}
    made.odometry_frame.map_from_odometry = Pose.from_yaw(0.1, np.array([0.4, 0.2, 0.1]))
    made.odometry_frame.drift_m = 3.25
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
    for name in ("map_from_odometry", "distance_m", "drift_m"):
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


def test_what_was_read_back_is_saved_as_the_same_bytes(estimator, read_back):
    one, other = estimator_to_arrays(estimator), estimator_to_arrays(read_back)
    assert one.keys() == other.keys()
    for name, values in one.items():
        assert np.array_equal(np.asarray(other[name]), np.asarray(values)), name


def test_saving_changes_nothing(estimator):
    before = [(entry.factor, entry.term) for entry in estimator.smoother.window.entries]
    costs = [dict(vars(tag.cost)) for _, tag in estimator.smoother.objects.observations()]
    estimator_to_arrays(estimator)
    assert [(entry.factor, entry.term) for entry in estimator.smoother.window.entries] == before
    assert [vars(tag.cost) for _, tag in estimator.smoother.objects.observations()] == costs


def test_every_factor_is_read_back_as_itself(estimator, read_back):
    """The same errors, elsewhere too: a linear one in its place would differ there."""
    rng = np.random.default_rng(0)
    for one, other in zip(all_entries(estimator), all_entries(read_back), strict=True):
        assert type(other.origin) is type(one.origin)
        assert other.keys == one.keys
        if one.origin is not None and not isinstance(one.tag, ObservationTag):
            values = all_values(estimator)
            steps = gtsam.VectorValues()
            for key in one.origin.keys():  # noqa: SIM118 # no mapping
                steps.insert(key, rng.normal(0, 0.1, values.extract([key]).dim()))
            moved = values.retract(steps)
            assert other.origin.error(moved) == one.origin.error(moved) > 0


def test_observations_of_landmarks_in_view_stay_open(estimator, read_back):
    """The motion test asks for them, and they are linearized once more when their landmark leaves."""
    one, other = (each.smoother.objects.open_observations() for each in (estimator, read_back))
    assert [(tag.number, tag.frame) for tag in other] == [(tag.number, tag.frame) for tag in one]
    assert one
    assert all(tag.cost.view is not None for tag in other)
    held = {id(entry.tag) for entry in all_entries(read_back)}
    assert all(id(tag) in held for tag in other)


def test_the_imu_is_no_linear_factor(read_back):
    kinds = {type(entry.origin) for entry in all_entries(read_back)}
    assert gtsam.CombinedImuFactor in kinds
    assert {entry.record.kind for entry in all_entries(read_back) if entry.record} >= {"imu", "first camera", "size"}


@pytest.mark.parametrize("what", ["record_numbers", "record_kinds", "linear_rows", "view_root", "entries", "view_pose"])
def test_arrays_that_do_not_fit_each_other_are_refused(setup, estimator, what):
    arrays = estimator_to_arrays(estimator)
    arrays[what] = np.asarray(arrays[what])[:-1]
    with pytest.raises((MeshslamError, ValueError, IndexError, RuntimeError)):
        estimator_from_arrays(SlamEstimator(setup), arrays)


def all_entries(estimator):
    smoother = estimator.smoother
    return [*smoother.history.entries, *smoother.window.entries]


def all_values(estimator):
    values = gtsam.Values(estimator.smoother.history.values)
    values.insert(estimator.smoother.window.values)
    return values
