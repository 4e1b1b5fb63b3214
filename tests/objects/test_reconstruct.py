"""What a fit takes as given while it moves the object."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.mapping import MappingConfig
from meshslam.mapping.pipeline import make_scene
from meshslam.mapping.selection import usable_tracks
from meshslam.mapping.work import observe
from meshslam.objects.config import ObjectConfig
from meshslam.objects.occlusion import Occluders
from meshslam.objects.reconstruction import (
    find_start,
    fit_free_form,
    fit_modes,
    reconstruct,
    uncertainty,
    with_surface_error,
)
from meshslam.objects.start_search import flipped


@pytest.fixture(scope="module")
def scene(frames, tracked, car):
    return make_scene(frames, tracked, car, ObjectConfig())


@pytest.fixture(scope="module")
def observed(frames, tracked, scene):
    tracks, _ = usable_tracks(frames, tracked, "car", MappingConfig(), scene.config.min_view_box_px)
    occluders = Occluders(frames.camera, tracked.by_frame(), frames.pose_of_frame())
    return observe(max(tracks, key=lambda t: len(t.detections)), scene, occluders)


@pytest.fixture(scope="module")
def found(observed, scene):
    return reconstruct(observed, scene)


def with_noise(scene, **changes):
    return replace(scene, config=replace(scene.config, noise=replace(scene.config.noise, **changes)))


def sigmas(scene, observed, found):
    covariance, _, _ = uncertainty(observed, scene, found)
    return np.sqrt(np.diag(covariance))


def test_the_rougher_the_surface_the_less_sure_the_pose(observed, scene, found):
    rough = [with_noise(scene, surface_sigma_m=sigma) for sigma in (0.0, 0.025, 0.1)]
    sure, less, least = (sigmas(s, with_surface_error(observed, s, found.state), found) for s in rough)
    assert (sure <= less * (1 + 1e-9)).all()
    assert (less <= least * (1 + 1e-9)).all()
    assert least[1] > 1.2 * sure[1]


def test_a_surface_without_error_changes_nothing(observed, scene, found):
    exact = with_noise(scene, surface_sigma_m=0.0)
    assert np.array_equal(
        sigmas(exact, with_surface_error(observed, exact, found.state), found), sigmas(exact, observed, found)
    )


def test_a_surface_sigma_below_zero_is_refused(observed):
    with pytest.raises(ValueError, match="must not be negative, found -1"):
        observed.views[0].with_surface_sigma(-1.0)


def configured(scene, **changes):
    return replace(scene, config=replace(scene.config, **changes))


def of_views(observed, count):
    track, views = observed.track.subset(range(count)), observed.views[:count]
    return replace(observed, track=track, views=views)


def test_free_form_needs_views_that_confirm_it(observed, scene, found):
    least = scene.config.free_form_views
    few = fit_free_form(of_views(observed, least - 1), scene, found)
    assert not few.state.d.any()
    assert fit_free_form(of_views(observed, least), scene, found).state.d.any()


def test_a_start_that_costs_far_more_goes_no_further_and_would_not_have_won(observed, scene, found):
    right = found.state.world_from_object
    strict = configured(scene, start_margin=0.0, start_margin_share=0.0)
    loose = configured(scene, start_margin=1e9)
    (kept,) = fit_modes(observed, strict, [flipped(right), right])
    one, other = fit_modes(observed, loose, [flipped(right), right])
    assert other.cost < one.cost
    assert kept.cost == other.cost


def test_headings_are_searched_only_where_key_points_give_no_start(observed, scene, found):
    quick, searched = (find_start(observed, configured(scene, start_overlap=s)) for s in (0.0, 1.1))
    assert len(quick) == 2  # upright, and as the key points say
    assert len(searched) == 2 + scene.config.start_candidates
    near = np.linalg.norm(quick[0][1].translation - found.state.world_from_object.translation)
    assert near < 1.0


@pytest.mark.parametrize("place", [0, 1])
def test_each_start_is_tried_both_ways_round(observed, scene, found, monkeypatch, place):
    right = found.state.world_from_object
    aside = Pose(right.rotation, right.translation + [6.0, 2.0, 0.0])  # another place, as good as none
    starts = [(0.0, aside), (1.0, aside)]
    starts[place] = (float(place), flipped(right))
    monkeypatch.setattr("meshslam.objects.reconstruction.find_start", lambda *_: starts)
    again = reconstruct(observed, scene).state.world_from_object
    assert again.rotation[:, 0] @ right.rotation[:, 0] > 0.99
    assert np.linalg.norm(again.translation - right.translation) < 0.2
