"""Tracking on drawn scenes: textured rectangles that move, hide each other, vanish and come back."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from meshslam.perception import (
    CategoryEntry,
    Detection,
    DetectionSet,
    ImageEntry,
    TrackerConfig,
    encode_mask,
    track,
    voted_category,
    write_detections,
)

HEIGHT, WIDTH = 160, 320
PAPER = TrackerConfig(tracker="paper")
BOTH = pytest.mark.parametrize("config", [TrackerConfig(), PAPER], ids=["hungarian", "paper"])


class Scene:
    """Rectangles (x, y, width, height) by (frame, object); later objects hide earlier ones."""

    def __init__(self, boxes, frames, keypoints=False, missed=(), categories=None):
        self.images, self.truth, rows = {}, {}, []
        textures = [_texture(10 + n, 160, 160, 40 + 40 * n) for n in range(len(boxes))]
        for frame in range(frames):
            image, owner = _texture(1, HEIGHT, WIDTH, 120).copy(), np.full((HEIGHT, WIDTH), -1)
            places = [np.round(box(frame)).astype(int) for box in boxes]
            for n, (x, y, w, h) in enumerate(places):
                patch = cv2.resize(textures[n], (w, h), interpolation=cv2.INTER_AREA)
                x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + w, WIDTH), min(y + h, HEIGHT)
                if x0 < x1 and y0 < y1:
                    image[y0:y1, x0:x1] = patch[y0 - y : y1 - y, x0 - x : x1 - x]
                    owner[y0:y1, x0:x1] = n
            self.images[frame] = image
            for n, place in enumerate(places):
                mask = (owner == n).astype(np.uint8)
                if mask.sum() < 60 or (frame, n) in missed:
                    continue
                number = len(rows) + 1
                category = categories(frame, n) if categories else "car"
                rows.append(_detection(number, frame, mask, place if keypoints else None, category))
                self.truth[number] = n
        names = ("car", "truck", "person")
        self.detections = DetectionSet(
            tuple(ImageEntry(i, f"{i:06d}.png", WIDTH, HEIGHT) for i in range(frames)),
            tuple(CategoryEntry(i + 1, name, ("a", "b", "c", "d")) for i, name in enumerate(names)),
            tuple(rows),
        )

    def tracks(self, config=None, read_image=True, detections=None, turn=None):
        """Track, and return {track: the true objects on it} and {true object: its tracks}."""
        found = track(detections or self.detections, self.images.__getitem__ if read_image else None, config, turn=turn)
        by_track, by_object = {}, {}
        for d in found.detections:
            if d.track_id is not None:
                by_track.setdefault(d.track_id, set()).add(self.truth[d.id])
                by_object.setdefault(self.truth[d.id], set()).add(d.track_id)
        return by_track, by_object


def _texture(seed, height, width, level):
    noise = np.random.default_rng(seed).normal(0, 1, (height, width, 1)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 5)[..., None]
    return np.clip(level + smooth * 500, 0, 255).astype(np.uint8).repeat(3, axis=2)


def _detection(number, frame, mask, place, category):
    points = scores = None
    if place is not None:
        x, y, w, h = place
        points = np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]], float) * 0.8 + 0.2 * np.array(
            [x + w / 2, y + h / 2]
        )
        inside = ((points >= 0) & (points < (WIDTH, HEIGHT))).all(1)
        scores = np.where(inside, 0.8, 0.0)
    box = tuple(float(v) for v in cv2.boundingRect(mask))
    return Detection(number, frame, category, 0.9, box, encode_mask(mask), mask.shape, points, scores)


def steady(x, y, w, h, step, grow=0.0):
    def box(frame):
        scale = 1 + grow * frame
        return np.array([x + step * frame - w * (scale - 1) / 2, y - h * (scale - 1) / 2, w * scale, h * scale])

    return box


@BOTH
@pytest.mark.parametrize("keypoints", [False, True])
def test_everything_keeps_its_identity(config, keypoints):
    boxes = [steady(20, 20, 50, 40, 9), steady(250, 30, 40, 30, -6, 0.04), steady(100, 90, 70, 50, 3, 0.02)]
    by_track, by_object = Scene(boxes, 12, keypoints).tracks(config)
    assert by_object == {0: {1}, 1: {2}, 2: {3}}
    assert all(len(objects) == 1 for objects in by_track.values())


def test_fast_objects_are_followed_by_their_texture():
    boxes = [steady(5, 40, 70, 80, 40), steady(80, 40, 70, 80, 40)]  # by more than half their width
    _, by_object = Scene(boxes, 5).tracks()
    assert by_object == {0: {1}, 1: {2}}


def test_two_that_cross_keep_their_identities():
    boxes = [steady(20, 40, 60, 50, 12), steady(240, 50, 50, 40, -12)]
    _, by_object = Scene(boxes, 18).tracks()
    assert by_object == {0: {1}, 1: {2}}


def test_a_gap_is_bridged_and_in_the_papers_mode_ends_the_track():
    missed = {(frame, 0) for frame in (4, 5, 6)}
    scene = Scene([steady(20, 40, 60, 50, 10), steady(240, 90, 50, 40, -5)], 12, missed=missed)
    assert scene.tracks()[1] == {0: {1}, 1: {2}}
    assert scene.tracks(PAPER)[1] == {0: {1, 3}, 1: {2}}
    assert scene.tracks(TrackerConfig(max_gap=2))[1] == {0: {1, 3}, 1: {2}}
    assert scene.tracks(TrackerConfig(max_gap=3))[1] == {0: {1}, 1: {2}}


def test_a_new_object_in_the_place_of_a_lost_one_is_new():
    def leaves(frame):
        return np.array([100, 40, 60, 50]) if frame < 5 else np.array([-500, 40, 60, 50])

    def comes(frame):
        return np.array([100, 40, 60, 50]) if frame >= 6 else np.array([-500, 40, 60, 50])

    assert Scene([leaves, comes], 10).tracks(PAPER)[1] == {0: {1}, 1: {2}}


def test_without_images_overlap_and_even_motion_decide():
    boxes = [steady(20, 20, 50, 40, 9), steady(250, 30, 40, 30, -6), steady(100, 90, 70, 50, 3, 0.02)]
    scene = Scene(boxes, 12, missed={(6, 0), (7, 0)})
    assert scene.tracks(read_image=False)[1] == {0: {1}, 1: {2}, 2: {3}}


def test_cars_in_a_row_keep_their_identities_as_the_camera_turns():
    """It turns by as much a frame as the cars are apart: each mask comes to lie where its neighbour's was."""
    boxes = [steady(150 + 50 * n, 60, 40, 30, -49) for n in range(8)]
    turn = np.array([[1, 0, -49], [0, 1, 0], [0, 0, 1]], float)
    scene = Scene(boxes, 7)
    by_track, by_object = scene.tracks(read_image=False, turn=lambda first, other: turn)
    assert all(len(tracks) == 1 for tracks in by_object.values())
    assert all(len(objects) == 1 for objects in by_track.values())
    mixed, _ = scene.tracks(read_image=False)
    assert any(len(objects) > 1 for objects in mixed.values())


def test_given_identities_stay():
    scene = Scene([steady(20, 20, 50, 40, 9), steady(250, 30, 40, 30, -6)], 10)
    rows = scene.detections.detections
    some = {d.id: 7 for d in rows if scene.truth[d.id] == 0 and d.frame in (3, 4)}
    partly = scene.detections.with_tracks(some)
    assert scene.tracks(detections=partly)[1] == {0: {7}, 1: {1}}
    wrong = scene.detections.with_tracks({d.id: 7 for d in rows if d.frame == 3})  # two of one frame
    found = track(wrong, scene.images.__getitem__)
    assert {d.id for d in found.detections if d.frame == 3 and d.track_id == 7} == {d.id for d in rows if d.frame == 3}

    def unread(frame):
        raise AssertionError("an image was read though all identities are given")

    given = scene.detections.with_tracks({d.id: scene.truth[d.id] + 40 for d in rows})
    assert write_detections(track(given, unread)) == write_detections(given)


def test_new_numbers_avoid_the_given_ones():
    scene = Scene([steady(20, 20, 50, 40, 9), steady(250, 30, 40, 30, -6), steady(100, 90, 70, 50, 3)], 6)
    given = scene.detections.with_tracks({d.id: 1 for d in scene.detections.detections if scene.truth[d.id] == 2})
    assert scene.tracks(detections=given)[1] == {0: {2}, 1: {3}, 2: {1}}


def test_a_vehicle_that_changes_its_class_is_one_and_others_are_left_alone():
    def flips(frame, n):
        return ("truck" if frame % 3 == 1 else "car") if n == 0 else "person"

    scene = Scene([steady(20, 20, 50, 40, 9), steady(250, 30, 40, 30, -6)], 10, categories=flips)
    found = track(scene.detections, scene.images.__getitem__)
    (vehicle,) = found.by_track().values()
    assert len(vehicle) == 10
    assert voted_category(vehicle) == "car"
    assert {d.category for d in vehicle} == {"car", "truck"}


def test_what_lies_inside_a_better_one_has_no_track():
    scene = Scene([steady(20, 20, 80, 60, 9)], 6)
    parts = []
    for d in scene.detections.detections:
        part = d.mask()
        part[:, : int(d.bbox[0]) + 50] = 0
        box = tuple(float(v) for v in cv2.boundingRect(part))
        parts.append(replace(d, id=d.id + 100, segmentation=encode_mask(part), bbox=box, score=0.95))
        scene.truth[d.id + 100] = 1
    both = replace(scene.detections, detections=(*parts, *scene.detections.detections))
    assert scene.tracks(detections=both)[1] == {0: {1}}


@pytest.mark.parametrize("read_image", [True, False])
def test_empty_frames_and_masks_are_handled(read_image):
    scene = Scene([steady(20, 20, 50, 40, 9)], 6, missed={(0, 0), (2, 0), (5, 0)})
    assert scene.tracks(read_image=read_image)[1] == {0: {1}}
    empty = encode_mask(np.zeros((HEIGHT, WIDTH), np.uint8))
    nothing = tuple(replace(d, segmentation=empty) for d in scene.detections.detections)
    assert scene.tracks(detections=replace(scene.detections, detections=nothing))[1] == {}
    assert scene.tracks(detections=replace(scene.detections, detections=()))[1] == {}


@BOTH
def test_the_same_input_gives_the_same_bytes(config):
    scene = Scene([steady(20, 40, 60, 50, 12), steady(240, 50, 50, 40, -12)], 10, missed={(4, 0)})
    written = {write_detections(track(scene.detections, scene.images.__getitem__, config)) for _ in range(2)}
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    written.add(write_detections(track(scene.detections, scene.images.__getitem__, config)))
    cv2.setNumThreads(threads)
    assert len(written) == 1
