"""Runs side by side: cars by place, the better figure, frames that both can draw, and the page."""

import re
from dataclasses import replace

import numpy as np
import pytest

from meshslam.errors import MapError
from meshslam.geometry import Pose
from meshslam.maps import Map, Trajectory
from meshslam.runs import compare_cars, compare_runs
from meshslam.viewing import ComparedRun, better_of, comparison_page, differing_settings, figure_rows_of
from tests.evaluation.conftest import (  # noqa: F401 # fixtures
    car,
    make_car,
    moved,
    random_path,
    true_cars,
    write_masks,
    write_run,
    write_truth,
)


def run_of(figures, settings=None, name="run"):
    return ComparedRun(name, name, np.zeros(0), (), Map(()), figures, settings or {})


def test_cars_are_matched_by_place_not_by_number(true_cars, rng):  # noqa: F811
    order = rng.permutation(len(true_cars)).tolist()
    others = [moved(c, 70 + k, (0.3, 0, 0), yaw=0.1) for c, k in zip(true_cars, order, strict=True)]
    far = moved(true_cars[0], 99, (0, 30, 0))
    found = compare_cars(Map(tuple(true_cars[:-1])), Map((*others, far)))
    expected = {(c.id, 70 + k) for c, k in zip(true_cars[:-1], order, strict=False)}
    assert {(p.first_id, p.other_id) for p in found.pairs} == expected
    assert (found.only_first, set(found.only_other)) == ((), {99, 70 + order[-1]})
    for pair in found.pairs:
        assert np.linalg.norm(pair.centre_m) == pytest.approx(0.3)
        assert pair.yaw_deg == pytest.approx(np.degrees(0.1))
        assert pair.size_m == pytest.approx(np.zeros(3))
        assert 0.5 < pair.iou < 1


def test_differences_are_along_the_first_car(make_car):  # noqa: F811
    one = make_car(1, [5.0, 5.0, 1.0], yaw=np.pi / 2)
    found = compare_cars(Map((one,)), Map((moved(one, 2, (0, 0.5, 0), scale=1.1),))).pairs[0]
    np.testing.assert_allclose(found.centre_m, [0.5, 0, 0], atol=1e-9)  # it looks along y
    np.testing.assert_allclose(found.size_m, 0.1 * one.dimensions)


def test_a_run_beside_itself_differs_in_nothing(write_masks, true_cars):  # noqa: F811
    run = write_masks(true_cars, true_cars)
    found = compare_runs([run, run])
    assert len(found.cars[0].pairs) == len(true_cars)
    for pair in found.cars[0].pairs:
        assert pair.iou == pytest.approx(1.0, abs=1e-3)
        assert np.abs([*pair.centre_m, *pair.size_m, pair.yaw_deg]).max() < 1e-9
    assert found.distances_m[0][1].max() == 0
    assert not any(row.best for row in figure_rows_of(found.runs))
    assert differing_settings(found.runs) == []
    assert len(found.frames) == 3
    for frame in found.frames:
        np.testing.assert_array_equal(*frame.pictures)


def test_alignment_lays_another_world_on_the_first(write_masks, true_cars, tmp_path):  # noqa: F811
    run = write_masks(true_cars, true_cars)
    world, path = Pose.from_yaw(1.0, np.array([40.0, 3.0, 0.0])), Trajectory.load(run / "trajectory.tum")
    steps = Pose(np.eye(3), np.zeros(3))
    other = tmp_path / "other"
    other.mkdir()
    Trajectory(path.times_s, tuple(world @ p @ steps for p in path.world_from_camera)).save(other / "trajectory.tum")
    Map(tuple(replace(c, world_from_object=world @ c.world_from_object) for c in true_cars)).save(other)
    apart = compare_runs([run, other])
    assert not apart.cars[0].pairs
    assert apart.distances_m[0][1].min() > 10
    laid = compare_runs([run, other], align=True)
    assert laid.distances_m[0][1].max() < 1e-6


@pytest.mark.parametrize(
    ("key", "values", "best"),
    [
        ("recall", (0.5, 0.7), {1}),
        ("ate_rmse_m", (0.5, 0.7), {0}),
        ("ate_rmse_m", (0.5, None), set()),
        ("ate_rmse_m", (0.5, 0.5), set()),
        ("ate_rmse_m", (0.5, 0.5, 0.9), {0, 1}),
        ("frames", (5, 7), set()),
        ("object_position_nees", (5.0, 7.0), set()),
    ],
)
def test_the_better_figure(key, values, best):
    runs = [run_of({} if value is None else {key: value}) for value in values]
    assert figure_rows_of(runs)[0].best == best


def test_every_figure_of_evaluate_has_a_direction_or_none_on_purpose():
    neither = {"ate_sim3_scale", "voxel_iou_category_model", "kitti_segments"}
    from meshslam.evaluation import PROTOCOLS

    assert {better_of(key) for key in neither} == {None}
    assert better_of("kitti_t_rel_percent") == better_of("mota_id_switches") == better_of("chamfer_mean_m") == "lower"
    assert better_of("hota") == better_of("a3dp_rel_mean") == better_of("kitti_ap_3d_70_percent") == "higher"
    assert len(PROTOCOLS) == 18


def test_settings_that_differ_are_named():
    runs = [run_of({}, {"a.b": 1, "c": [1, 2]}), run_of({}, {"a.b": 2, "c": [1, 2], "d": None})]
    assert differing_settings(runs) == [("a.b", ["1", "2"]), ("d", ["not set", "null"])]


def test_the_page_is_whole_and_offline(write_masks, true_cars, tmp_path):  # noqa: F811
    run = write_masks(true_cars, true_cars)
    page = comparison_page(compare_runs([run, run, run]))
    assert not re.search(r'(src|href)="?(?!data:|#)[a-z]+:', page)
    assert "default-src 'none'" in page
    assert page.count("<img data-run=") == 9
    for letter in "ABC":
        assert f'">{letter}</span>' in page
    assert "$" not in re.sub(r"<script>.*?</script>", "", page, flags=re.S).replace("${", "")


def test_names_of_folders_cannot_break_the_page(write_masks, true_cars):  # noqa: F811
    run = write_masks(true_cars, true_cars)
    odd = run.rename(run.parent / "<script>alert(1)</script>".replace("/", "_"))
    page = comparison_page(compare_runs([odd, odd]))
    assert "<script>alert" not in page


def test_runs_that_lack_parts_are_told(write_masks, true_cars, tmp_path):  # noqa: F811
    run = write_masks(true_cars, true_cars)
    other = tmp_path / "localized"
    other.mkdir()
    (other / "trajectory.tum").write_bytes((run / "trajectory.tum").read_bytes())
    found = compare_runs([run, other])
    assert not found.frames
    assert not found.cars[0].only_first
    assert any("localized" in note and "map.json" in note for note in found.notes)
    comparison_page(found)
    with pytest.raises(MapError, match="a comparison needs two runs"):
        compare_runs([run])
    (tmp_path / "empty").mkdir()
    with pytest.raises(MapError, match="no run: expected"):
        compare_runs([run, tmp_path / "empty"])
