from dataclasses import replace

import numpy as np
import pytest

from meshslam.objects import ObjectConfig
from meshslam.objects.track import Track, choose_views, is_cut

CONFIG = ObjectConfig()


@pytest.fixture
def make_track(box_detection, drive):
    def make(widths, step=1.0):
        boxes = [(10, 20, int(w), 60) for w in widths]
        found = tuple(box_detection(i + 1, i, box, track=1) for i, box in enumerate(boxes))
        return Track(1, found, drive(len(widths), step), np.arange(len(widths)) * 0.1)

    return make


@pytest.mark.parametrize("count", [1, 2, 4, 16])
def test_views_are_as_many_as_asked_in_order_with_both_ends(make_track, count):
    chosen = choose_views(make_track([60] * 40), count, CONFIG)
    assert len(chosen) == count
    assert chosen == sorted(set(chosen))
    assert chosen[0] == 0
    assert count == 1 or chosen[-1] == 39


def test_few_detections_are_all_taken(make_track):
    assert choose_views(make_track([50, 60, 70]), 16, CONFIG) == [0, 1, 2]


def test_small_boxes_are_left_out_unless_there_are_no_others(make_track):
    track = make_track([10, 12, 40, 60, 15, 80])
    assert choose_views(track, 16, CONFIG) == [2, 3, 5]
    assert choose_views(make_track([10, 12, 9]), 16, CONFIG) == [1]


def test_views_are_spread_by_how_the_line_of_sight_turns(make_track):
    """Where the box is large the same step turns the line of sight more: more views are taken there."""
    chosen = choose_views(make_track([30] * 20 + [160] * 20), 10, CONFIG)
    assert sum(i >= 20 for i in chosen) > sum(i < 20 for i in chosen)


def test_a_camera_that_stands_still_gives_views_all_the_same(make_track):
    chosen = choose_views(make_track([60] * 30, step=0.0), 5, CONFIG)
    assert len(chosen) == 5
    assert np.diff(chosen).min() >= 4


def test_a_subset_keeps_detections_cameras_and_times_together(make_track):
    part = make_track([60] * 9).subset([1, 5])
    assert [d.frame for d in part.detections] == [1, 5]
    assert [p.translation[0] for p in part.world_from_camera] == [1.0, 5.0]
    np.testing.assert_allclose(part.times_s, [0.1, 0.5])


def test_a_box_is_cut_at_the_left_right_and_lower_edge(camera, box_detection):
    inside = box_detection(1, 0, (50, 40, 60, 50))
    assert not is_cut(inside, camera, 3)
    w, h = camera.width, camera.height
    for box in ((1, 40, 60, 50), (w - 61, 40, 60, 50), (50, h - 51, 60, 50)):
        assert is_cut(replace(inside, bbox=tuple(map(float, box))), camera, 3)
