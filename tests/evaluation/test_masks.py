import numpy as np
import pytest

from meshslam.errors import MapError, MeshslamError
from meshslam.evaluation import score_masks
from meshslam.maps import Trajectory
from tests.evaluation.conftest import moved


@pytest.fixture
def row(make_car):
    """Cars beside the path, the second partly behind the first, the third cut by the image's border."""
    places = [[9.0, 2.6, 0.8], [14.0, 2.0, 0.8], [5.5, -2.4, 0.8]]
    return [make_car(i + 1, place, 0.1 * i) for i, place in enumerate(places)]


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # pycocotools, in the tool
def test_figures_are_those_of_the_independent_tool(score_run, row, write_masks, rng):
    off = [moved(thing, thing.id, rng.normal(0, 0.2, 3), 0.1, 1.05) for thing in row]
    run = write_masks(row, off, fray=3)
    ours, theirs = score_masks(run), score_run.score_masks(run)
    assert ours.detections == theirs["detections"] > 4
    assert ours.eligible == theirs["eligible"]
    assert ours.figures()["mask_iou"] == pytest.approx(theirs["mask_iou_mean"], abs=2e-3)
    assert ours.figures()["mask_share_mapped"] == theirs["share_mapped"]
    assert ours.figures()["mask_iou"] < 0.9


def test_drawn_masks_are_perfect_also_where_others_hide_them(row, write_masks):
    scores = score_masks(write_masks(row, row))
    assert set(scores.iou_of_object.values()) == {1.0}
    assert scores.detections == scores.eligible


def test_detections_without_an_object_are_eligible_only(row, write_masks):
    figures = score_masks(write_masks(row, row[:1])).figures()
    assert figures["mask_iou"] > 0.95
    assert 0 < figures["mask_share_mapped"] <= 0.5
    assert score_masks(write_masks(row, [])).figures() == {"mask_iou": 0.0, "mask_share_mapped": 0.0}


def test_without_detections_there_are_no_figures(row, write_masks):
    assert score_masks(write_masks([], row)).figures() == {}


def test_poses_that_do_not_fit_the_images_are_named(row, write_masks):
    run = write_masks(row, row)
    path = Trajectory.load(run / "trajectory.tum")
    Trajectory(path.times_s[:2], path.world_from_camera[:2]).save(run / "trajectory.tum")
    with pytest.raises(MapError, match=r"trajectory\.tum: 2 poses, but detections\.json has 3 images"):
        score_masks(run)


@pytest.mark.parametrize("name", ["camera.yaml", "trajectory.tum", "map.json", "detections.json"])
def test_a_missing_file_is_named(row, write_masks, name):
    run = write_masks(row, row)
    (run / name).unlink()
    with pytest.raises(MeshslamError, match=name):
        score_masks(run)


def test_an_object_at_the_camera_is_scored(make_car, write_masks):
    around = make_car(1, [1.0, 0.0, 0.8])
    scores = score_masks(write_masks([around], [around]))
    assert np.allclose(list(scores.iou_of_object.values()), 1.0)
