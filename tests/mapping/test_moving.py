"""Which tracks are tried as objects that drive, and what tells each of them what shapes there are."""

from types import SimpleNamespace

import numpy as np
import pytest

from meshslam.mapping import LeftOut, MappingConfig
from meshslam.mapping import moving as mapping_moving
from meshslam.moving import Begun, Estimated, PathBounds, ShapeEvidence, ShapePrior

MODES = 2


def shape(value):
    return ShapeEvidence(np.full(MODES, value), 0.1 * np.eye(MODES))


def stands(number, gain, value=0.0, mask_iou=0.9):
    work = SimpleNamespace(observed=SimpleNamespace(track=SimpleNamespace(id=number)))
    thing = SimpleNamespace(mask_iou=mask_iou)
    return SimpleNamespace(work=work, unfit=None, object=thing, shape=shape(value), motion_gain=gain)


@pytest.fixture
def priors(monkeypatch):
    """Map tracks without fitting any; gives each tried track's first and last prior, and what its path must reach."""
    begun, ended, bounds = {}, {}, {}

    def begin(track, standing, observed, scene, occluders, settings, prior):
        begun[track.id] = prior
        return Begun(track, standing, None, shape(10.0 + track.id))

    def finish(one, scene, occluders, settings, prior, needed):
        ended[one.track.id], bounds[one.track.id] = prior, needed
        return Estimated(None, "no path")

    first = SimpleNamespace(found=SimpleNamespace(state=None), observed=None)
    monkeypatch.setattr(mapping_moving, "first_pass", lambda *_: first)
    monkeypatch.setattr(mapping_moving, "begin_moving", begin)
    monkeypatch.setattr(mapping_moving, "finish_moving", finish)

    def of(left_out, numbers, standing):
        tracks = [SimpleNamespace(id=number) for number in numbers]
        scene = SimpleNamespace(model=SimpleNamespace(mode_count=MODES))
        found = mapping_moving.map_moving(left_out, tracks, standing, scene, None, MappingConfig())
        return found, begun, ended, bounds

    return of


def test_tried_are_what_moves_what_fits_nowhere_and_what_the_motion_test_doubts(priors):
    reasons = {1: "moves", 2: "too far", 3: "too few views", 4: "the same object", 5: "does not fit its masks"}
    left_out = [LeftOut(number, reason, "so") for number, reason in reasons.items()]
    standing = [stands(6, 3.9), stands(7, 4.1), stands(8, 0.0, mask_iou=0.84), stands(9, 0.0, mask_iou=0.86)]
    found, begun, _, _ = priors(left_out, range(1, 10), standing)
    assert sorted(begun) == [1, 2, 5, 7, 8]
    details = {row.track: row.detail for row in found.left_out}
    assert details == {1: "so; no path", 2: "so", 3: "so", 4: "so", 5: "so"}


def test_a_path_must_reach_more_where_an_object_that_stands_fits_too(priors):
    config = MappingConfig()
    _, _, _, bounds = priors([LeftOut(1, "moves")], (1, 7), [stands(7, 26.0)])
    assert bounds[1] == PathBounds(config.moving.min_gain, config.min_mask_iou)
    assert config.moving.standing_gain > config.moving.min_gain
    assert bounds[7] == PathBounds(config.moving.standing_gain, config.moving.standing_mask_iou)
    _, _, _, bounds = priors([], (6, 8), [stands(6, 26.0, mask_iou=0.3), stands(8, 26.0, mask_iou=0.63)])
    assert bounds[6].mask_iou == config.min_mask_iou
    assert bounds[8].mask_iou == pytest.approx(0.73)


def test_all_others_tell_a_tracks_shape_and_it_does_not_tell_its_own(priors):
    """What stands after all, 7, tells its shape as what stands does: 50, not 17."""
    standing = [stands(8, 0.0, 1.0), stands(9, 0.0, 2.0), stands(7, 26.0, 50.0)]
    _, begun, ended, _ = priors([LeftOut(1, "moves"), LeftOut(2, "moves")], (1, 2, 7), standing)
    first = {7: 50.0, 8: 1.0, 9: 2.0}
    last = {1: 11.0, 2: 12.0, **first}
    for number in (1, 2, 7):
        for found, told in ((begun, first), (ended, last)):
            others = [shape(value) for n, value in sorted(told.items()) if n != number]
            np.testing.assert_allclose(found[number].mean, ShapePrior.of_drive(others, MODES).mean)
