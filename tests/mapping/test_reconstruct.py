"""What a fit takes as given while it moves the object."""

from dataclasses import replace

import numpy as np
import pytest

from meshslam.mapping.config import MappingConfig
from meshslam.mapping.occlusion import Occluders
from meshslam.mapping.pipeline import make_scene
from meshslam.mapping.reconstruct import reconstruct, uncertainty, with_surface_error
from meshslam.mapping.selection import usable_tracks
from meshslam.mapping.work import observe


@pytest.fixture(scope="module")
def scene(frames, tracked, car):
    return make_scene(frames, tracked, car, MappingConfig())


@pytest.fixture(scope="module")
def observed(frames, tracked, scene):
    tracks, _ = usable_tracks(frames, tracked, "car", scene.config)
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
