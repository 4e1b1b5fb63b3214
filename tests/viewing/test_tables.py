import re
from dataclasses import replace

import pytest

from meshslam.maps import Map
from meshslam.viewing.markup import number, script_json, table, text
from meshslam.viewing.tables import (
    FIGURES,
    describe,
    figures_table,
    left_out_list,
    notes_list,
    objects_table,
    time_bars,
)


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


def test_doubts_stand_in_words(context, make_car):
    context = replace(context, map=Map((make_car(1, 9.0, 0.0, views=1), make_car(2, 9.0, 5.0))))
    shown = objects_table(context)
    assert shown.count("class=doubt") == 1
    assert "one view shows it" in shown


def test_notes_are_listed_as_text(context):
    assert notes_list(replace(context, notes=("2 steps < 3 m", "another"))) == (
        "<ul><li>2 steps &lt; 3 m</li><li>another</li></ul>"
    )
    assert notes_list(context) == ""


def test_what_is_left_out_has_its_reason(context):
    shown = left_out_list(context)
    assert "track 4" in shown
    assert "moves" in shown
    assert left_out_list(replace(context, left_out=())) == ""


def test_bars_are_as_long_as_the_stages_took():
    shown = time_bars({"seconds_mapping": 4.0, "seconds_tracking": 1.0, "seconds_total": 9.0})
    assert re.findall(r"width:([\d.]+)%", shown) == ["25.0", "100.0"]
    assert time_bars({"seconds_mapping": 0.0}) == time_bars({}) == ""


def test_narrow_screens_get_headings_beside_the_cells():
    assert '<td data-label="seen, %">5</td>' in table(['<abbr title="x">seen, %</abbr>'], [["5"]])


def test_numbers_and_text_are_safe():
    assert number(-1.26, 1) == "&minus;1.3"
    assert [number(v, 2) for v in (None, float("nan"), float("inf"))] == ["&ndash;"] * 3
    assert "<" not in text('<b a="\'">')
    assert "</script>" not in script_json({"a": "</script>"})
