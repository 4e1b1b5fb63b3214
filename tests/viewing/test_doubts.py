import numpy as np
import pytest

from meshslam.viewing.doubts import doubts, position_sigma_m, seen_share


def test_a_car_that_is_known_well_has_none(make_car):
    assert doubts(make_car(1, 5.0, 0.0)) == []
    bare = make_car(1, 5.0, 0.0, pose_covariance=None, vertex_observed=None, mask_iou=None, views=0)
    assert doubts(bare) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pose_covariance": np.diag([0.9, 0.1, 0.1, 0.1, 0.1, 0.1]) ** 2}, "sigma is 0.90 m"),
        ({"vertex_observed": np.arange(642) < 6}, "views fix 1% of its surface"),
        ({"views": 1}, "one view shows it"),
        ({"views": 2}, "2 views show it"),
        ({"mask_iou": 0.61}, "IoU 0.61"),
    ],
)
def test_each_doubt_is_told_with_its_figure(make_car, change, words):
    [said] = doubts(make_car(1, 5.0, 0.0, **change))
    assert words in said


def test_the_least_certain_axis_counts_whatever_the_heading(make_car, rng):
    for yaw in rng.uniform(-3, 3, 10):
        thing = make_car(1, 0.0, 0.0, yaw, pose_covariance=np.diag([0.3, 0.1, 0.05, 1, 1, 1]) ** 2)
        assert position_sigma_m(thing) == pytest.approx(0.3)


def test_the_share_seen_is_of_the_vertices(make_car):
    assert seen_share(make_car(1, 0.0, 0.0, vertex_observed=np.arange(642) < 321)) == 0.5
