"""Shape over the number of views, on one kind of car."""

import csv
import json

import numpy as np
import pytest

from meshslam.experiments.left_out import left_out_instances
from meshslam.experiments.page import write_experiment
from meshslam.experiments.views import ViewsConfig, chosen_views, looking_at, views_experiment
from meshslam.objects import ObjectConfig

SMALL = ViewsConfig(kinds=("hatch",), views=(1, 3), paper_views=(), family=30)


@pytest.fixture(scope="module")
def found():
    steps = []
    experiment = views_experiment(SMALL, ObjectConfig(), lambda *step: steps.append(step))
    assert ("reconstruct", 2, 2) in steps
    return experiment


def test_three_views_give_the_shape_of_a_kind_that_was_left_out(found):
    one, three = found.rows
    assert (one["views"], three["views"]) == (1, 3)
    assert three["voxel_iou"] >= 0.90
    assert three["voxel_iou"] > max(one["voxel_iou"], three["mean_mesh_voxel_iou"])
    assert three["mask_iou"] > 0.96


def test_files_and_page_hold_the_figures_beside_the_papers(found, tmp_path):
    page = write_experiment(found, tmp_path / "views").read_text()
    rows = list(csv.DictReader((tmp_path / "views" / "views.csv").read_text().splitlines()))
    assert [float(row["voxel_iou"]) for row in rows] == [row["voxel_iou"] for row in found.rows]
    assert json.loads((tmp_path / "views" / "views.json").read_text())["rows"] == [dict(r) for r in found.rows]
    assert "over 0.8" in page
    assert "0.630" in page
    for name in ("views.png", "cameras.png", "meshes.png"):
        assert (tmp_path / "views" / name).read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "views" / "views.svg").read_bytes() == next(
        p.content for p in found.pictures if p.name == "views.svg"
    )
    assert "<svg" in page


def test_the_shape_space_holds_no_car_of_the_kind():
    """Of two kinds drawn at once, each space is that of the others: they differ, and give the same again."""
    first, second = (left_out_instances(("saloon", "hatch"), 1, 14, 3) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.category.vertices, b.category.vertices)
        np.testing.assert_array_equal(a.body.vertices, b.body.vertices)
    assert np.abs(first[0].category.vertices - first[1].category.vertices).max() > 0.05
    assert np.abs(first[0].body.vertices - first[1].body.vertices).max() > 0.1


@pytest.mark.parametrize("count", range(1, 13))
def test_views_are_spread_over_the_ring(count):
    views = chosen_views(count, 12)
    assert len(set(views)) == count
    gaps = np.diff([*views, views[0] + 12])
    assert gaps.max() - gaps.min() <= 1


def test_a_camera_looks_at_its_target_and_is_level():
    eye, target = np.array([3.0, -4.0, 1.65]), np.array([0.1, 0.2, 0.7])
    pose = looking_at(eye, target)
    seen = pose.inverse().transform(target)
    np.testing.assert_allclose(seen, [0, 0, np.linalg.norm(target - eye)], atol=1e-12)
    assert pose.rotation[2, 0] == pytest.approx(0.0)
    assert pose.rotation[2, 1] < 0
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0)
