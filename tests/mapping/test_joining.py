"""Two tracks in one place are joined if one object fits both, and only then."""

import numpy as np
import pytest

from meshslam.mapping import MappingConfig
from meshslam.mapping.joining import join_tracks
from meshslam.mapping.pipeline import make_scene
from meshslam.mapping.selection import usable_tracks
from meshslam.mapping.work import Work, first_pass, mean_iou, observe
from meshslam.objects import ObjectConfig

CONFIG = MappingConfig()


class Nothing:
    """Nothing hides anything."""

    def __init__(self, camera):
        self.shape = camera.height, camera.width

    def before(self, _):
        return np.zeros(self.shape, np.uint8)


@pytest.fixture(scope="module")
def scene(frames, tracked, car):
    return make_scene(frames, tracked, car, ObjectConfig())


@pytest.fixture(scope="module")
def occluders(frames):
    return Nothing(frames.camera)


@pytest.fixture(scope="module")
def parked(street, frames, tracked, scene):
    """Tracks of the parked cars, the longest first."""
    moving = {car.id for car in street.cars if car.moves}
    tracks, _ = usable_tracks(frames, tracked, "car", CONFIG, scene.config.min_view_box_px)
    return sorted((t for t in tracks if t.id not in moving), key=lambda t: -len(t.detections))


def test_two_halves_of_one_cars_track_become_one(frames, tracked, scene, occluders, parked):
    whole = parked[0]
    second = whole.detections[len(whole.detections) // 2 :]
    halves = tracked.with_tracks({d.id: 77 for d in second})
    tracks, _ = usable_tracks(frames, halves, "car", CONFIG, scene.config.min_view_box_px)
    work = [first_pass(t, scene, occluders) for t in tracks if t.id in (whole.id, 77)]
    joined, (kept,), (left_out,) = join_tracks(work, halves, scene, occluders, CONFIG, fixed_tracks=False)
    keep = kept.observed.track.id
    assert {keep, left_out.track} == {whole.id, 77}
    assert left_out.detail == f"joined with track {keep}"
    assert [d.id for d in joined.by_track()[keep]] == [d.id for d in whole.detections]
    assert left_out.track not in joined.by_track()
    assert len(kept.observed.track.detections) > max(len(w.observed.track.detections) for w in work)
    assert mean_iou(kept, scene) > 0.8


def test_tracks_of_two_cars_that_seem_to_stand_in_one_place_are_not_joined(tracked, scene, occluders, parked):
    """One car is seen first and the other then, and the second's estimate is wrong: no one object fits both."""
    early = {d.id for d in parked[0].detections if d.frame < 8}
    late = {d.id for d in parked[1].detections if d.frame >= 8}
    apart = tracked.with_tracks({d.id: None for d in tracked.detections if d.id not in early | late})
    tracks = [t.subset([i for i, d in enumerate(t.detections) if d.id in early | late]) for t in parked[:2]]
    first = first_pass(tracks[0], scene, occluders)
    wrong = Work(observe(tracks[1], scene, occluders), first.found)
    for work in ([first, wrong], [wrong, first]):
        found, kept, left_out = join_tracks(work, apart, scene, occluders, CONFIG, fixed_tracks=False)
        assert found is apart
        assert kept == [first]
        assert [(row.track, row.detail) for row in left_out] == [
            (parked[1].id, f"stands where track {parked[0].id} does")
        ]


def test_tracks_that_were_given_are_never_joined(tracked, scene, occluders, parked):
    one = first_pass(parked[0], scene, occluders)
    work = [one, one]
    assert join_tracks(work, tracked, scene, occluders, CONFIG, fixed_tracks=True) == (tracked, work, [])
