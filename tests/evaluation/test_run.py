import json
from dataclasses import replace

import numpy as np
import pytest

from meshslam.errors import MeshslamError
from meshslam.evaluation import evaluate_run, read_truth
from meshslam.geometry import Pose


def test_without_truth_there_are_no_figures(write_truth, write_run, true_cars, random_path):
    assert evaluate_run(write_truth(), write_run(true_cars, random_path())) == {}


def test_without_results_there_are_no_figures(write_truth, write_run, true_cars, random_path):
    case = write_truth(true_cars, {thing.id: 6 for thing in true_cars}, random_path())
    assert evaluate_run(case, write_run()) == {}


def test_keys_are_those_of_the_contract(write_truth, write_run, true_cars, random_path):
    path = random_path()
    found = replace(path, world_from_camera=tuple(p @ Pose(np.eye(3), np.full(3, 0.1)) for p in path.world_from_camera))
    case, run = write_truth(true_cars, {thing.id: 6 for thing in true_cars}, path), write_run(true_cars, found)
    assert set(evaluate_run(case, run)) == {*OF_OBJECTS, "ate_rmse_m", "end_error_percent"}


OF_OBJECTS = {
    "voxel_iou_mean",
    "voxel_iou_category_model",
    "centre_error_median_m",
    "yaw_error_median_deg",
    "recall",
}


def test_a_path_that_was_given_is_not_scored(write_truth, write_run, true_cars, random_path):
    path = random_path()
    case, run = write_truth(true_cars, {thing.id: 6 for thing in true_cars}, path), write_run(true_cars, path)
    assert set(evaluate_run(case, run)) == OF_OBJECTS


def test_truth_without_association_counts_every_object(write_truth, write_run, true_cars):
    found = evaluate_run(write_truth(true_cars), write_run(true_cars[:3]))
    assert found["recall"] == 0.5


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("objects.json", "{", "cannot be read as JSON"),
        ("objects.json", '{"objects": [{"id": 1, "category": "car"}]}', r"objects\[0\]: mesh"),
        ("objects.json", '{"objects": 3}', "expected a list"),
        ("association.json", "[1, 2]", "found list"),
        ("association.json", '{"1": "two"}', "'1': expected annotation id: object id, found 'two'"),
        ("association.json", '{"x": 2}', "'x': expected annotation id"),
        ("association.json", "\x00", "cannot be read as JSON"),
        ("groundtruth.tum", "0 1 2 3\n", "line 1"),
        ("groundtruth.tum", "", "no poses"),
        ("groundtruth.tum", "0 0 0 0 0 0 0 1\n0.1 nan 0 0 0 0 0 1\n", "line 2"),
    ],
)
def test_damaged_truth_is_named(write_truth, true_cars, random_path, name, content, said):
    case = write_truth(true_cars, {thing.id: 6 for thing in true_cars}, random_path())
    (case / name).write_text(content)
    with pytest.raises(MeshslamError, match=said) as caught:
        read_truth(case)
    assert name in str(caught.value)


def test_a_missing_mesh_is_named(write_truth, true_cars):
    case = write_truth(true_cars)
    (case / "meshes" / f"{true_cars[2].id}.ply").unlink()
    with pytest.raises(MeshslamError, match=f"{true_cars[2].id}.ply"):
        read_truth(case)


def test_truth_is_only_read(write_truth, write_run, true_cars, random_path):
    path = random_path()
    case, run = write_truth(true_cars, {thing.id: 6 for thing in true_cars}, path), write_run(true_cars, path)
    before = {p: p.read_bytes() for folder in (case, run) for p in folder.rglob("*") if p.is_file()}
    figures = evaluate_run(case, run)
    assert {p: p.read_bytes() for folder in (case, run) for p in folder.rglob("*") if p.is_file()} == before
    json.dumps(figures, allow_nan=False)
