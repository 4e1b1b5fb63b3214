"""What an object's views keep from pass to pass."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from meshslam.mapping import MappingConfig, map_objects
from meshslam.mapping.pipeline import NOISE_TRACKS, make_scene, noise_tracks
from meshslam.mapping.selection import usable_tracks
from meshslam.mapping.work import HeldViews, first_pass, fit_again, mean_iou, observe, observe_again
from meshslam.objects import ObjectConfig, uncertainty, view_bytes
from meshslam.objects.observations import make_view
from meshslam.objects.reconstruction import motion, reconstruct


class Hiding:
    """Nothing hides anything, but for some frames in which everything is hidden."""

    def __init__(self, camera, *frames):
        self.shape, self.frames = (camera.height, camera.width), frames

    def before(self, detection):
        return np.full(self.shape, detection.frame in self.frames, np.uint8)

    def differs(self, other, detection):
        return not np.array_equal(self.before(detection), other.before(detection))


@pytest.fixture(scope="module")
def scene(frames, tracked, car):
    return make_scene(frames, tracked, car, ObjectConfig())


@pytest.fixture(scope="module")
def track(frames, tracked, scene):
    tracks, _ = usable_tracks(frames, tracked, "car", MappingConfig(), scene.config.min_view_box_px)
    return max(tracks, key=lambda t: len(t.detections))


def test_only_views_that_something_else_hides_are_made_anew(scene, track, frames):
    nothing = Hiding(frames.camera)
    before = observe(track, scene, nothing)
    changed = before.track.detections[1].frame
    hidden = Hiding(frames.camera, changed)
    after = observe_again(before, scene, nothing, hidden)
    same = [a is b for a, b in zip(before.views, after.views, strict=True)]
    assert same == [d.frame != changed for d in before.track.detections]
    assert all(a is b for a, b in zip(after.views, observe_again(after, scene, hidden, hidden).views, strict=True))


def test_views_made_anew_are_those_of_a_new_look(scene, track, frames):
    nothing, hidden = Hiding(frames.camera), Hiding(frames.camera, track.detections[2].frame)
    again = observe_again(observe(track, scene, nothing), scene, nothing, hidden)
    new = observe(track, scene, hidden)
    found = reconstruct(new, scene)
    (one, gain), (other, same_gain) = (motion(views, scene, found) for views in (again, new))
    np.testing.assert_array_equal(one, other)  # the views' times and all that they show
    assert gain == same_gain
    clear, _ = motion(observe(track, scene, nothing), scene, found)
    assert not np.array_equal(clear, other)


def test_views_that_were_let_go_and_made_again_are_what_they_were(scene, track, frames):
    work = fit_again(first_pass(track, scene, Hiding(frames.camera, track.detections[1].frame)), scene)
    gone = work.without_views()
    assert not gone.observed.views
    there = gone.with_views(scene)
    assert len(there.observed.views) == len(work.observed.views)
    for state in (work.found.start, work.found.state):
        assert mean_iou(gone, scene, state) == mean_iou(work, scene, state)
    (a, b), (c, d) = (uncertainty(w.observed, scene, w.found)[:2] for w in (work, there))
    assert np.array_equal(a, c)  # the surface's sigmas are there, too
    assert np.array_equal(b, d)


def test_so_many_tracks_hold_their_views_as_there_is_room_for(scene, track, frames):
    bytes_of_track = sum(
        view_bytes(d, scene.camera, scene.config) for d in observe(track, scene, Hiding(frames.camera)).track.detections
    )
    another = replace(track, id=track.id + 1)
    for limit, held in ((0, set()), (bytes_of_track, {track.id}), (2 * bytes_of_track, {track.id, another.id})):
        assert HeldViews.of([track, another], scene, limit).tracks == held


def test_a_street_is_mapped_to_the_same_bits_whether_views_are_held_or_not(frames, tracked, car, monkeypatch):
    config = ObjectConfig(), MappingConfig()
    whole = map_objects(frames, tracked, car, *config, fixed_tracks=True)
    made = Counter()

    def counted(model, camera, pose, time_s, detection, *given):
        made[detection.id] += 1
        return make_view(model, camera, pose, time_s, detection, *given)

    monkeypatch.setattr("meshslam.objects.track.make_view", counted)
    monkeypatch.setattr("meshslam.mapping.work.HELD_BYTES", 0)
    lean = map_objects(frames, tracked, car, *config, fixed_tracks=True)
    # once a sweep; of what moves in two sweeps, and then for its start, its path, that path again, and its shape
    assert sorted(set(made.values())) == [3, 6]
    assert whole.mask_ious == lean.mask_ious
    assert whole.left_out == lean.left_out
    for a, b in zip(whole.map.objects, lean.map.objects, strict=True):
        assert np.array_equal(a.world_from_object.matrix, b.world_from_object.matrix)
        assert np.array_equal(a.vertices, b.vertices)
        assert np.array_equal(a.vertex_sigma_m, b.vertex_sigma_m)
        assert np.array_equal(a.pose_covariance, b.pose_covariance)


def test_the_noise_of_a_long_drive_is_told_by_some_tracks_spread_over_it(track):
    few, many = ([replace(track, id=k) for k in range(count)] for count in (NOISE_TRACKS, 10 * NOISE_TRACKS))
    assert noise_tracks([]) == frozenset()
    assert len(noise_tracks(few)) == NOISE_TRACKS
    asked = sorted(noise_tracks(many))
    assert len(asked) == NOISE_TRACKS
    assert np.diff(asked).max() <= 11
