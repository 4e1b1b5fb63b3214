"""Objects known again: laws over random constellations."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.object_slam.landmarks import (
    Landmark,
    OdometryFrame,
    coincident_landmarks,
    find_loop_closure,
    joined_tracks,
)
from meshslam.object_slam.loop_closure import LoopClosureConfig, PlacedLandmark, match_landmarks

CONFIG = LoopClosureConfig()
SIZE = np.array([4.4, 1.8, 1.5])


def constellation(rng, count):
    places = np.column_stack(
        [np.cumsum(rng.uniform(7, 18, count)), rng.uniform(-5, 5, count), rng.normal(0, 0.1, count)]
    )
    return [PlacedLandmark(i + 1, i + 1, Pose.from_yaw(rng.normal(0, 0.05), p), SIZE) for i, p in enumerate(places)]


def moved(things, motion, rng, noise_m=0.1):
    out = []
    for thing in things:
        pose = motion @ thing.pose
        shaken = Pose(pose.rotation, pose.translation + rng.normal(0, noise_m, 3))
        out.append(PlacedLandmark(thing.number + 100, thing.track + 100, shaken, thing.dimensions))
    return out


@pytest.mark.parametrize("seed", range(8))
def test_a_drifted_path_is_laid_back(seed):
    rng = np.random.default_rng(seed)
    known = constellation(rng, 10)
    drift = Pose.from_yaw(rng.normal(0, 0.01), rng.normal(0, 3, 3) * [1, 1, 0.1])
    seen = moved(known[3:8], drift, rng)
    found = match_landmarks(seen, known, [12.0] * len(known), CONFIG)
    assert set(found.pairs) == {(n + 100, n) for n in range(4, 9)}
    back = [found.correction @ thing.pose for thing in seen]
    assert max(np.linalg.norm(b.translation - k.pose.translation) for b, k in zip(back, known[3:8], strict=True)) < 0.6


@pytest.mark.parametrize("seed", range(8))
def test_other_cars_are_not_taken_for_known_ones(seed):
    rng = np.random.default_rng(seed)
    known, strangers = constellation(rng, 10), constellation(rng, 4)
    assert match_landmarks(moved(strangers, Pose.identity(), rng), known, [8.0] * 10, CONFIG) is None


def test_size_heading_and_distance_speak_against_a_pair():
    rng = np.random.default_rng(0)
    known = constellation(rng, 4)
    seen = moved(known, Pose.identity(), rng, 0.0)
    radii = [1.0] * 4
    assert len(match_landmarks(seen, known, radii, CONFIG).pairs) == 4
    larger = [PlacedLandmark(t.number, t.track, t.pose, 1.3 * t.dimensions) for t in seen]
    turned = [PlacedLandmark(t.number, t.track, t.pose @ Pose.from_yaw(np.pi, np.zeros(3)), t.dimensions) for t in seen]
    away = moved(known, Pose(np.eye(3), np.array([0.0, 2.0, 0.0])), rng, 0.0)
    assert all(match_landmarks(others, known, radii, CONFIG) is None for others in (larger, turned, away))


def test_one_is_enough_only_where_the_path_is_sure():
    rng = np.random.default_rng(1)
    known = constellation(rng, 5)
    seen = moved(known[:1], Pose.identity(), rng)
    assert match_landmarks(seen, known, [1.5] * 5, CONFIG).pairs == ((101, 1),)
    assert match_landmarks(seen, known, [5.0] * 5, CONFIG) is None


def of_tracks(seen, tracks):
    return [replace(thing, track=track) for thing, track in zip(seen, tracks, strict=True)]


def test_two_pairs_of_one_track_each_are_enough():
    """A tracker took each for one object before it was known where they are; one alone may be its mistake."""
    rng = np.random.default_rng(2)
    known = constellation(rng, 6)
    seen = moved(known[1:3], Pose(np.eye(3), np.array([3.0, 0.0, 0.0])), rng)
    assert match_landmarks(seen, known, [8.0] * 6, CONFIG) is None
    assert match_landmarks(of_tracks(seen, (2, 3)), known, [8.0] * 6, CONFIG).pairs == ((102, 2), (103, 3))
    assert match_landmarks(of_tracks(seen[:1], (2,)), known, [8.0] * 6, CONFIG) is None
    apart = [seen[0], replace(seen[1], pose=Pose(np.eye(3), np.array([0.0, 6.0, 0.0])) @ seen[1].pose)]
    assert match_landmarks(of_tracks(apart, (2, 3)), known, [12.0] * 6, CONFIG) is None


def test_an_older_landmark_of_the_same_track_is_no_contradiction():
    """One of a wrong heading is no partner of its older self, and stands where that stood."""
    rng = np.random.default_rng(3)
    known = constellation(rng, 6)
    seen = moved(known[1:5], Pose(np.eye(3), np.array([3.0, 0.0, 0.0])), rng)
    seen[3] = replace(seen[3], pose=seen[3].pose @ Pose.from_yaw(np.radians(142), np.zeros(3)))
    assert match_landmarks(seen, known, [8.0] * 6, CONFIG) is None
    found = match_landmarks([*seen[:3], replace(seen[3], track=5)], known, [8.0] * 6, CONFIG)
    assert set(found.pairs) == {(102, 2), (103, 3), (104, 4)}


# --- the search radius: 1 m and 2% of the distance travelled, at most 12 m


def drifted(off_m, left_at_m=0.0):
    """Three landmarks that left the view, and the same three seen anew, all of them off by a distance."""
    seen = {"views": 20, "nearest_m": 8.0, "drift_m": left_at_m}
    landmarks = {}
    for k in (1, 2, 3):
        known, found = (Pose(np.eye(3), np.array([8.0 * k + off, 3.0, 0.0])) for off in (0.0, off_m))
        landmarks[k] = Landmark(k, k, known, np.zeros(2), SIZE, **seen, in_map=known)
        landmarks[k + 10] = Landmark(k + 10, k + 10, found, np.zeros(2), SIZE, **seen)
    return landmarks, {11, 12, 13}


def closes(marks, at, joined=(), config=CONFIG):
    landmarks, in_view = marks
    return find_loop_closure(landmarks, in_view, joined, at, config) is not None


@pytest.mark.parametrize(("distance_m", "radius_m"), [(0.0, 1.0), (100.0, 3.0), (300.0, 7.0), (5000.0, 12.0)])
def test_the_search_radius_grows_with_the_distance_up_to_a_limit(distance_m, radius_m):
    at = OdometryFrame(Pose.identity(), distance_m, distance_m)
    spread = replace(CONFIG, min_separation_m=0.1)
    assert closes(drifted(0.95 * radius_m), at, config=spread)
    assert not closes(drifted(1.05 * radius_m), at, config=spread)


def closed_with(at, drift_m):
    """The frame after a loop closure with a landmark that was seen after a drift."""
    pose = Pose.identity()
    at.close(pose, [Landmark(1, 1, pose, np.zeros(2), SIZE, drift_m=drift_m)])
    return at


def test_a_loop_closure_takes_the_drift_back_to_where_the_older_landmark_was_seen():
    marks = drifted(3.0)
    assert closes(marks, OdometryFrame(Pose.identity(), 300.0, 300.0))
    assert not closes(marks, closed_with(OdometryFrame(Pose.identity(), 300.0, 300.0), 0.0))
    assert not closes(marks, closed_with(OdometryFrame(Pose.identity(), 300.0, 300.0), 80.0))
    assert closes(marks, closed_with(OdometryFrame(Pose.identity(), 300.0, 300.0), 120.0))


def test_a_closure_with_what_was_seen_a_moment_ago_leaves_the_drift():
    """Else a car that is lost from view for some frames before a loop's end would hide the loop."""
    at = closed_with(OdometryFrame(Pose.identity(), 600.0, 600.0), 580.0)
    assert at.drift_m == 580.0
    assert closes(drifted(6.5), at)
    assert closed_with(at, 590.0).drift_m == 580.0


def test_the_drift_grows_with_the_way():
    at = OdometryFrame(Pose.identity(), 600.0, 10.0)
    at.travel(2.5)
    assert (at.distance_m, at.drift_m) == (602.5, 12.5)


def test_a_landmark_seen_further_along_than_the_camera_now_is_has_drifted_too():
    """Once a loop is closed, what lies on its far side is as far away along the path as before."""
    assert closes(drifted(3.0, left_at_m=300.0), OdometryFrame(Pose.identity(), 600.0, 10.0))


def test_what_left_the_view_just_now_is_searched_nearby():
    at = OdometryFrame(Pose.identity(), 300.0, 300.0)
    assert closes(drifted(3.0, left_at_m=100.0), at)
    assert not closes(drifted(3.0, left_at_m=290.0), at)


def test_landmarks_that_are_joined_are_not_joined_again():
    landmarks, in_view = drifted(0.2)
    at = OdometryFrame()
    assert set(find_loop_closure(landmarks, in_view, [], at, CONFIG).pairs) == {(11, 1), (12, 2), (13, 3)}
    assert set(find_loop_closure(landmarks, in_view, [(11, 1)], at, CONFIG).pairs) == {(12, 2), (13, 3)}
    assert find_loop_closure(landmarks, in_view, [(11, 1), (12, 2), (13, 3)], at, CONFIG) is None


def test_what_moves_and_what_was_seen_little_or_from_afar_closes_no_loop():
    at = OdometryFrame()
    for change, which in (
        ({"moves": True}, (1, 2, 3)),
        ({"views": 7}, (11, 12, 13)),
        ({"nearest_m": 26.0}, (11, 12, 13)),
    ):
        landmarks, in_view = drifted(0.2)
        landmarks |= {n: replace(landmarks[n], **change) for n in which}
        assert find_loop_closure(landmarks, in_view, [], at, CONFIG) is None


def test_tracks_of_one_object_get_its_lowest_number():
    marks = {n: Landmark(n, track, Pose.identity(), np.zeros(2), SIZE) for n, track in ((1, 7), (2, 9), (3, 8), (4, 7))}
    assert joined_tracks(marks, [(2, 1), (3, 2)]) == {9: 7, 8: 7}
    assert joined_tracks(marks, [(4, 1)]) == {}


def test_what_stands_in_one_place_is_one():
    places = {
        n: Pose(np.eye(3), np.array([x, 0.0, 0.0])) for n, x in ((1, 0.0), (2, 9.0), (3, 0.5), (4, 9.4), (5, 20.0))
    }
    assert coincident_landmarks(places, [], 1.5) == [(3, 1), (4, 2)]
    assert coincident_landmarks(places, [(3, 1)], 1.5) == [(4, 2)]
