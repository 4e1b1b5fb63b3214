"""Tracking frame by frame gives what tracking a whole sequence gives, here and where it was saved and loaded."""

import json
from dataclasses import replace

import numpy as np
import pytest

from meshslam.perception import TrackerConfig, grey, track
from meshslam.perception.online_tracking import OnlineTracker
from meshslam.perception.tracking import Tracker
from tests.perception.test_tracking import Scene, steady


def swerving(x, y, w, h, steps):
    """A box whose motion changes from frame to frame: what is expected of it depends on its past."""
    at = np.concatenate([[0.0], np.cumsum(steps)])
    return lambda frame: np.array([x + at[frame], y, w, h])


SCENES = {
    "steady": lambda: Scene([steady(20, 20, 50, 40, 9), steady(250, 30, 40, 30, -6), steady(100, 90, 70, 50, 3)], 12),
    "growing, with key points": lambda: Scene([steady(20, 20, 50, 40, 9), steady(150, 70, 70, 50, 3, 0.03)], 12, True),
    "missed in between": lambda: Scene(
        [steady(20, 40, 60, 50, 10), steady(240, 90, 50, 40, -5)], 12, missed={(f, 0) for f in (4, 5, 6)}
    ),
    "lost and new": lambda: Scene([steady(20, 40, 60, 50, 10)], 14, missed={(f, 0) for f in range(4, 11)}),
    "swerving": lambda: Scene(
        [
            swerving(20, 20, 30, 30, [18, 2, 18, 2, 18, 2, 18, 2, 18, 2, 18]),
            swerving(20, 80, 26, 30, [8, 24, 24, 4, 24, 24, 4, 24, 24, 4, 24]),
            swerving(58, 80, 26, 30, [8, 24, 24, 4, 24, 24, 4, 24, 24, 4, 24]),
        ],
        12,
        missed={(5, 1), (8, 1), (9, 2)},
    ),
}
OVER_SCENES = pytest.mark.parametrize("scene", [pytest.param(make, id=name) for name, make in SCENES.items()])
IMAGES = pytest.mark.parametrize("with_images", [True, False])


def frames_of(scene, with_images, detections=None):
    """Detections and image of each frame."""
    found = (detections or scene.detections).by_frame()
    return [(found.get(f, ()), image if with_images else None) for f, image in scene.images.items()]


def online(frames, tracker=None):
    """Track of each detection, frame by frame."""
    tracker = tracker or OnlineTracker()
    return {d.id: d.track_id for found, image in frames for d in tracker.process(found, image)}


def batch(scene, with_images, detections=None):
    found = track(detections or scene.detections, scene.images.__getitem__ if with_images else None)
    return {d.id: d.track_id for d in found.detections}


def groups(numbers):
    """Which detections share a number."""
    return {frozenset(d for d, n in numbers.items() if n == number) for number in set(numbers.values())}


@OVER_SCENES
@IMAGES
def test_frame_by_frame_the_same_detections_are_one(scene, with_images):
    scene = scene()
    found = online(frames_of(scene, with_images))
    assert groups(found) == groups(batch(scene, with_images))
    assert found == batch(scene, with_images)  # and by the same numbers: 1, 2, ... by first appearance


@IMAGES
def test_what_is_expected_of_an_object_is_the_same(with_images):
    """After every frame, the boxes' motion is that of the tracker that is given all frames."""
    scene = SCENES["swerving"]()
    one, whole = OnlineTracker(), Tracker(TrackerConfig())
    for found, image in frames_of(scene, with_images):
        one.process(found, image)
        whole.step(list(found), None if image is None else grey(image))
        held = one.to_arrays()
        for i, object_ in enumerate(whole.active):
            assert held[f"boxes_{i}"] == pytest.approx(np.stack([object_.last_seen, object_.motion]))


def test_the_motion_of_a_box_is_the_mean_of_its_last_step_and_what_it_was():
    steps = [18, 2, 18, 2, 6]
    scene, tracker, expected = Scene([swerving(20, 20, 40, 40, steps)], 6), OnlineTracker(), None
    for (found, _), step in zip(frames_of(scene, False), [None, *steps], strict=True):
        tracker.process(found)
        if step is not None:
            expected = step if expected is None else 0.5 * (step + expected)
            assert tracker.to_arrays()["boxes_0"][1] == pytest.approx([expected, 0, expected, 0])


def test_ids_of_detections_may_be_given_anew_in_each_frame():
    """A stream has no file whose ids are unique: the object that is missed leaves the others their numbers."""
    boxes = [steady(20, 20, 50, 40, 9), steady(250, 30, 40, 30, -6)]
    scene = Scene(boxes, 8, missed={(f, n) for f, n in ((3, 0), (4, 0), (6, 1))})
    tracker, found = OnlineTracker(), {0: set(), 1: set()}
    for rows, image in frames_of(scene, True):
        anew = [replace(d, id=1 + i) for i, d in enumerate(rows)][:: -1 if rows and rows[0].frame % 2 else 1]
        for d in tracker.process(anew, image):
            found[scene.truth[rows[d.id - 1].id]].add(d.track_id)
    assert found == {0: {1}, 1: {2}}


def test_given_numbers_stay_and_new_ones_pass_them_over():
    scene = SCENES["steady"]()
    given = {d.id: 2 for d in scene.detections.detections if scene.truth[d.id] == 2}
    found = online(frames_of(scene, True, scene.detections.with_tracks(given)))
    assert {scene.truth[d]: n for d, n in found.items()} == {0: 1, 1: 3, 2: 2}
    assert all(found[d] == 2 for d in given)


def test_a_number_that_is_given_late_is_kept_and_the_object_goes_on_under_it():
    scene = SCENES["steady"]()
    rows = scene.detections.detections
    late = {d.id: 9 for d in rows if scene.truth[d.id] == 0 and d.frame == 5}
    found = online(frames_of(scene, True, scene.detections.with_tracks(late)))
    numbers = [found[d.id] for d in rows if scene.truth[d.id] == 0]
    assert numbers == [1] * 5 + [9] * 7


@OVER_SCENES
@IMAGES
@pytest.mark.parametrize("after", [1, 5, 9])
def test_saved_in_the_middle_it_goes_on_in_the_same_way(scene, with_images, after):
    scene = scene()
    frames = frames_of(scene, with_images)
    first, second = OnlineTracker(), OnlineTracker()
    online(frames[:after], first)
    arrays = {name: np.array(value) for name, value in first.to_arrays().items()}
    second.fill(arrays)
    assert online(frames[after:], second) == online(frames[after:], first)
    one, other = first.to_arrays(), second.to_arrays()
    assert json.loads(str(one.pop("tracker"))) == json.loads(str(other.pop("tracker")))
    assert one.keys() == other.keys()
    assert all(np.array_equal(one[name], other[name]) for name in one)


def test_a_number_is_kept_though_those_before_it_are_free_again():
    """The first object gets the number 9 by a detection; once saved and loaded, the second is still 2."""
    scene = SCENES["steady"]()
    late = {d.id: 9 for d in scene.detections.detections if scene.truth[d.id] == 0 and d.frame == 3}
    frames = frames_of(scene, True, scene.detections.with_tracks(late))
    first, second = OnlineTracker(), OnlineTracker()
    online(frames[:5], first)
    second.fill(first.to_arrays())
    found = online(frames[5:], second)
    assert {scene.truth[d]: n for d, n in found.items()} == {0: 9, 1: 2, 2: 3}


def test_numbers_go_on_where_they_were_saved():
    scene = Scene([steady(20, 20, 50, 40, 9), steady(100, 90, 70, 50, 3)], 8, missed={(f, 1) for f in range(4)})
    frames = frames_of(scene, True)
    first, second = OnlineTracker(), OnlineTracker()
    taken = [(tuple(d.with_track(2) for d in found), image) for found, image in frames[:2]]
    online(taken, first)
    second.fill(first.to_arrays())
    found = online(frames[2:], second)
    assert {scene.truth[d]: n for d, n in found.items()} == {0: 2, 1: 1}
    second.fill(first.to_arrays())
    later = OnlineTracker()
    later.fill(second.to_arrays())
    assert later.to_arrays()["tracker"] == first.to_arrays()["tracker"]
