"""The mechanisms of one frame's work, each by a law of its own; runs go on from copies of one that was saved."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.geometry import Pose
from meshslam.graph.tags import RoadTag
from meshslam.motion import Mounting
from meshslam.object_slam import LoopClosureConfig, SlamConfig, SlamEstimator, object_start
from meshslam.object_slam.archive import estimator_from_arrays, estimator_to_arrays
from meshslam.object_slam.setup import SlamSetup
from meshslam.objects import ObjectConfig
from meshslam.perception import encode_mask
from tests.fixtures.imu_street import IMU_FROM_CAMERA, errors_m, slammed, start_of

QUICK = SlamConfig(min_baseline_m=2.0, loop_closure=LoopClosureConfig(min_views=2))
SAVED = 10  # frames before the copies go on


@pytest.fixture(scope="module")
def setup(drive, seen):
    car = load_category("car")
    return SlamSetup(drive.camera, car, seen.keypoint_names("car"), Mounting(IMU_FROM_CAMERA), 1.65, QUICK)


@pytest.fixture(scope="module")
def run(drive, seen):
    """Let an estimator go through frames, from the first on or from where it is."""
    by_frame = seen.by_frame()

    def go(estimator, until, detections=None, start=0):
        given = detections or by_frame
        for index in range(start, until):
            if index == 0:
                estimator.begin(0, start_of(drive), drive.imu, given[0])
            else:
                estimator.process(index, float(drive.times_s[index]), drive.imu, given[index])
        return estimator

    return go


@pytest.fixture(scope="module")
def saved(setup, run):
    return estimator_to_arrays(run(SlamEstimator(setup), SAVED))


@pytest.fixture
def copied(setup, saved):
    """Make copies of the run after its first frames, some settings of SLAM or of its setup changed."""

    def make(*, objects=None, height_above_ground_m=1.65, **changes):
        told = {"height_above_ground_m": height_above_ground_m, "objects": objects or setup.objects}
        estimator = SlamEstimator(replace(setup, slam=replace(QUICK, **changes), **told))
        estimator_from_arrays(estimator, saved)
        return estimator

    return make


def observations(estimator, number):
    """Frames whose observation of a landmark is a factor of the window."""
    return sorted(tag.frame for _, tag in estimator.smoother.objects.observations() if tag.number == number)


def shifted(detection, by_px):
    """The detection, its mask, box and key points moved aside."""
    by = np.float32([[1, 0, by_px], [0, 1, 0]])
    mask = cv2.warpAffine(detection.mask(), by, detection.image_size[::-1], flags=cv2.INTER_NEAREST)
    x, y, width, height = detection.bbox
    moved = replace(detection, segmentation=encode_mask(mask), bbox=(x + by_px, y, width, height))
    return replace(moved, keypoints=detection.keypoints + [by_px, 0.0])


# --- the gate


def test_an_observation_that_fits_badly_is_taken_back_and_the_others_stay(copied, run, seen):
    plain, by_frame = run(copied(), SAVED + 1, start=SAVED), seen.by_frame()
    shown = {d.track_id: d for d in by_frame[SAVED]}
    in_view = {track: n for track, n in copied().in_view.items() if track in shown}
    assert len(in_view) > 2
    for track, wrong in in_view.items():
        others = tuple(d for d in by_frame[SAVED] if d.track_id != track)
        estimator = copied()
        run(estimator, SAVED + 1, {**by_frame, SAVED: (*others, shifted(shown[track], 60.0))}, start=SAVED)
        assert observations(estimator, wrong) == [f for f in observations(plain, wrong) if f != SAVED]
        for number in set(in_view.values()) - {wrong}:
            assert observations(estimator, number) == observations(plain, number)
        assert np.linalg.norm(estimator.path[SAVED].translation - plain.path[SAVED].translation) < 0.02


def test_what_fits_is_never_taken_back(copied, run):
    estimator = run(copied(), SAVED + 1, start=SAVED)
    held = [n for n in estimator.in_view.values() if estimator.smoother.objects.last_frame(n) == SAVED]
    assert held
    assert all(SAVED in observations(estimator, n) for n in held)


# --- wheels on the road


def road_entries(estimator, number):
    return [e for e in estimator.smoother.window.entries if e.tag == RoadTag(number)]


def test_every_landmark_that_is_observed_stands_on_the_road_by_one_factor(copied, drive, seen):
    estimator = copied()
    report = estimator.process(SAVED, float(drive.times_s[SAVED]), drive.imu, seen.by_frame()[SAVED])
    assert len(report.objects) > 2
    for number in report.objects:
        (entry,) = road_entries(estimator, number)
        assert entry.factor.error(estimator.smoother.window.values) < 2.0


@pytest.mark.parametrize("height_m", [1.6, 1.75])
def test_wheels_are_as_far_below_the_camera_as_its_height_is_told(copied, drive, seen, height_m):
    """A road that is known to a millimetre, against observations that say 1.67 m."""
    exact = replace(ObjectConfig(), ground_height_sigma_m=1e-3, ground_slope_sigma=0.0)
    estimator = copied(objects=exact, height_above_ground_m=height_m, nearer=0.9999)
    for index in (SAVED, SAVED + 1):
        report = estimator.process(index, float(drive.times_s[index]), drive.imu, seen.by_frame()[index])
    for number in report.objects:
        mark = estimator.landmarks[number]
        wheels = mark.world_from_object.translation[2] + estimator.vertices(mark)[:, 2].min()
        assert estimator.path[SAVED + 1].translation[2] - wheels == pytest.approx(height_m, abs=0.04)


def test_the_height_is_measured_again_only_from_clearly_nearer(copied, run):
    estimator = copied(nearer=0.7)
    before = {n: m.nearest_m for n, m in estimator.landmarks.items() if n in estimator.in_view.values()}
    held = {n: road_entries(estimator, n)[0] for n in before}
    run(estimator, SAVED + 3, start=SAVED)
    for number in set(before) & set(estimator.in_view.values()):
        mark = estimator.landmarks[number]
        again = road_entries(estimator, number)[0] is not held[number]
        assert again == (mark.nearest_m < before[number])
        assert mark.nearest_m <= (0.7 if again else 1.0) * before[number]


def test_without_a_known_height_nothing_is_put_on_the_road(setup, run):
    estimator = run(SlamEstimator(replace(setup, height_above_ground_m=None)), 8)
    assert estimator.landmarks
    assert not any(isinstance(e.tag, RoadTag) for e in estimator.smoother.window.entries)
    assert all(np.isinf(mark.nearest_m) for mark in estimator.landmarks.values())


# --- moving objects


def test_a_moving_car_that_the_start_took_for_a_parked_one_is_taken_back(setup, run, street, monkeypatch):
    monkeypatch.setattr(object_start, "motion", lambda *_: (np.zeros(3), 0.0))  # the start's own test sees nothing
    lenient = replace(QUICK, motion_views=6, max_cost=1e9, min_mask_iou=0.0)
    estimator = run(SlamEstimator(replace(setup, slam=lenient)), len(street.times_s))
    moving = {car.id for car in street.cars if car.moves}
    marks = [mark for mark in estimator.landmarks.values() if mark.track in moving]
    assert marks, "no moving car became a landmark: the test shows nothing"
    for mark in marks:
        assert mark.moves
        assert mark.track in estimator.moving
        assert mark.track not in estimator.in_view
        assert observations(estimator, mark.number) == []
        assert not road_entries(estimator, mark.number)
    parked = [mark for mark in estimator.landmarks.values() if mark.track not in moving]
    assert parked
    assert not any(mark.moves for mark in parked)


# --- shapes that no car has


def test_a_landmark_whose_shape_no_car_has_is_taken_back_and_its_track_may_become_another(copied, run):
    estimator = run(copied(max_shape_error=1e-6), SAVED + 1, start=SAVED)
    withdrawn = [mark for mark in estimator.landmarks.values() if mark.is_withdrawn]
    assert withdrawn
    for mark in withdrawn:
        assert not mark.counts
        assert mark.track not in estimator.moving
        assert mark.track not in estimator.in_view
        assert observations(estimator, mark.number) == []
        assert not road_entries(estimator, mark.number)
    run(estimator, SAVED + 2, start=SAVED + 1)
    assert {mark.track for mark in withdrawn} & set(estimator.candidates)


def test_covariances_of_landmarks_are_there_when_one_was_taken_back_and_has_left_the_window(copied, run, drive):
    estimator = copied(max_shape_error=1e-6, start_views=1000, lag_s=0.3)
    run(estimator, SAVED + 1, start=SAVED)
    withdrawn = {n for n, mark in estimator.landmarks.items() if mark.is_withdrawn}
    run(estimator, len(drive), start=SAVED + 1)
    assert any(not estimator.smoother.objects.holds(n) for n in withdrawn)
    known = estimator.landmark_covariances()
    assert set(known) == {n for n, mark in estimator.landmarks.items() if mark.counts}


def test_the_size_that_all_cars_share_is_no_reason_to_take_one_back(copied, run):
    """All cars 10 sigmas larger along the scale direction are one place's large cars."""
    estimator = copied()
    mark = next(iter(estimator.landmarks.values()))
    before = estimator._shape_error(mark)
    mark.z = mark.z + 10.0 * estimator._scale_direction
    assert estimator._shape_error(mark) == pytest.approx(before)
    assert not any(m.is_withdrawn for m in run(copied(), SAVED + 2, start=SAVED).landmarks.values())


# --- the distance travelled and loop closure


def older(estimator, number, off_m):
    """Enter a landmark that left the view long ago, near one that is in view."""
    mark, new = estimator.landmarks[number], len(estimator.landmarks) + 1
    place = Pose(mark.world_from_object.rotation, mark.world_from_object.translation + off_m)
    estimator.landmarks[new] = replace(mark, number=new, track=1000 + new, in_map=place)
    return new


def test_the_distance_travelled_is_the_paths_length(setup, run):
    estimator = run(SlamEstimator(setup), SAVED)
    steps = np.diff([estimator.path[f].translation for f in range(SAVED)], axis=0)
    assert estimator.odometry_frame.distance_m == pytest.approx(np.linalg.norm(steps, axis=1).sum(), rel=0.01)
    assert estimator.odometry_frame.drift_m == estimator.odometry_frame.distance_m


def test_a_loop_closure_moves_the_odometrys_world_and_notes_where_it_was(copied, run):
    estimator, off_m = copied(), np.array([0.3, 0.2, 0.0])
    number = next(iter(estimator.in_view.values()))
    old = older(estimator, number, off_m)
    estimator.landmarks[old].drift_m = 0.125
    run(estimator, SAVED + 1, start=SAVED)
    at = estimator.odometry_frame
    assert estimator.joined == [(number, old)]
    assert at.drift_m == 0.125 < at.distance_m
    assert at.map_from_odometry.translation == pytest.approx(off_m, abs=0.05)
    run(estimator, SAVED + 2, start=SAVED + 1)
    assert estimator.joined == [(number, old)]  # one pair once
    assert at.drift_m > 0.125


def test_without_loop_closure_nothing_is_joined_and_the_distance_still_counts(copied, run):
    estimator = copied(loop_closure=LoopClosureConfig(enabled=False))
    before = estimator.odometry_frame.distance_m
    older(estimator, next(iter(estimator.in_view.values())), np.zeros(3))
    run(estimator, SAVED + 1, start=SAVED)
    assert estimator.joined == []
    assert np.array_equal(estimator.odometry_frame.map_from_odometry.matrix, np.eye(4))
    assert estimator.odometry_frame.distance_m > before


# --- the end


def test_two_landmarks_in_one_place_are_one_at_the_end(setup, run, seen, street):
    """A car whose track breaks: its halves are two landmarks, which stand in one place."""
    parked = [car.id for car in street.cars if not car.moves]
    seen_in = {car: [d for d in seen.detections if d.track_id == car] for car in parked}
    car = max(parked, key=lambda n: len(seen_in[n]))
    half = seen_in[car][len(seen_in[car]) // 2].frame
    broken = {
        frame: tuple(d.with_track(77) if d.track_id == car and frame >= half else d for d in found)
        for frame, found in seen.by_frame().items()
    }
    alone = replace(QUICK, loop_closure=LoopClosureConfig(enabled=False))
    estimator = run(SlamEstimator(replace(setup, slam=alone)), len(street.times_s), broken)
    number = {mark.track: mark.number for mark in estimator.landmarks.values()}
    assert {car, 77} <= set(number)
    full = estimator.finish()
    assert full.joined == ((number[77], number[car]),)
    first, second = (full.world_from_object[number[track]] for track in (car, 77))
    assert np.linalg.norm(first.translation - second.translation) < 0.1
    assert estimator.joined == []  # the run goes on as it was


# --- all together


@pytest.fixture(scope="module")
def found(drive, seen):
    return slammed(drive, seen)


def test_every_frame_has_a_pose_and_the_path_holds(found, drive, street):
    assert len(found.trajectory.world_from_camera) == len(drive)
    truth = street.world_from_camera
    length = np.linalg.norm(np.diff([p.translation for p in truth], axis=0), axis=1).sum()
    assert errors_m(found.trajectory.world_from_camera, truth)[-1] < 0.02 * length


def test_parked_cars_are_in_the_graph_and_the_one_that_drives_is_not(found):
    assert found.figures["objects_in_graph"] >= 2


def test_detections_that_come_late_count_for_their_own_frame(setup, run, drive, seen):
    frames, by_frame = len(drive), seen.by_frame()
    right, late = run(SlamEstimator(setup), frames), SlamEstimator(setup)
    late.begin(0, start_of(drive), drive.imu, by_frame[0])
    for index in range(1, frames):
        came = {index - 2: by_frame[index - 2]} if index >= 3 else {}
        late.process(index, float(drive.times_s[index]), drive.imu, None, came)
    late.observe({frame: by_frame[frame] for frame in (frames - 2, frames - 1)})
    assert {m.track for m in late.landmarks.values()} == {m.track for m in right.landmarks.values()}
    places = {m.track: m.world_from_object.translation for m in right.landmarks.values()}
    for mark in late.landmarks.values():
        assert np.linalg.norm(mark.world_from_object.translation - places[mark.track]) < 0.15
    errors = errors_m([late.path[f] for f in late.frame_ids], [right.path[f] for f in right.frame_ids])
    assert errors.max() < 0.05
    observed = {tag.frame for _, tag in late.smoother.objects.observations()}
    assert observed >= set(range(frames - 8, frames))


def test_detections_of_frames_that_have_left_the_window_are_passed_over(copied, drive, seen):
    estimator = copied()
    estimator.smoother.cameras.drop([estimator.smoother.frames[0]])
    before = len(estimator.smoother.objects.observations())
    gone = min(set(range(SAVED)) - set(estimator.smoother.frames))
    assert not estimator.holds(gone)
    estimator.observe({gone: seen.by_frame()[gone]})
    assert len(estimator.smoother.objects.observations()) == before
