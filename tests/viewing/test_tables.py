import numpy as np
import pytest

from meshslam.viewing.markup import number, px, script_json, text
from meshslam.viewing.tables import FIGURES, describe, figures_table, position_sigma_m


def test_every_figure_is_shown_with_its_name(rng):
    metrics = {key: float(rng.uniform(1, 100)) for key in (*FIGURES, "brand_new_m", "plain")}
    shown = figures_table(metrics)
    for key in metrics:
        assert shown.count(f"title='{key}'") == 1
    assert figures_table({}) == ""


@pytest.mark.parametrize(
    ("key", "label", "unit"),
    [("lidar_median_m", "lidar median", "m"), ("turn_deg", "turn", "°"), ("plain", "plain", ""), ("m", "m", "")],
)
def test_unknown_figures_tell_their_unit(key, label, unit):
    assert (describe(key).label, describe(key).unit) == (label, unit)


def test_the_least_certain_axis_counts_whatever_the_heading(make_car, rng):
    for yaw in rng.uniform(-3, 3, 10):
        thing = make_car(1, 0.0, 0.0, yaw, pose_covariance=np.diag([0.3, 0.1, 0.05, 1, 1, 1]) ** 2)
        assert position_sigma_m(thing) == pytest.approx(0.3)


def test_numbers_and_text_are_safe():
    assert number(-1.26, 1) == "&minus;1.3"
    assert [number(v, 2) for v in (None, float("nan"), float("inf"))] == ["&ndash;"] * 3
    assert [px(v) for v in (1.0, -0.04, 2.25, -3.5)] == ["1", "0", "2.2", "-3.5"]
    assert "<" not in text('<b a="\'">')
    assert "</script>" not in script_json({"a": "</script>"})
