"""What an object's views keep from pass to pass."""

import numpy as np
import pytest

from meshslam.mapping import MappingConfig
from meshslam.mapping.pipeline import make_scene
from meshslam.mapping.selection import usable_tracks
from meshslam.mapping.work import observe, observe_again
from meshslam.objects import ObjectConfig
from meshslam.objects.reconstruction import motion, reconstruct


class Hiding:
    """Nothing hides anything, but for some frames in which everything is hidden."""

    def __init__(self, camera, *frames):
        self.shape, self.frames = (camera.height, camera.width), frames

    def before(self, detection):
        return np.full(self.shape, detection.frame in self.frames, np.uint8)


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
