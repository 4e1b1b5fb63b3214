import numpy as np
import pytest

from meshslam.evaluation import evaluate_run, match_objects, object_figures, score_object
from meshslam.evaluation.objects import MATCH_DISTANCE_M, counted_objects
from meshslam.evaluation.truth import Truth
from meshslam.maps import Map
from tests.evaluation.conftest import moved


def figures_of(true_cars, estimates, shown=None):
    association = None
    if shown is not None:
        ids = [number for number, count in shown.items() for _ in range(count)]
        association = dict(enumerate(ids))
    return object_figures(Truth(Map(tuple(true_cars)), association, None), Map(tuple(estimates)))


def test_figures_are_those_of_the_independent_tool(score_run, true_cars, write_truth, write_run, make_car, rng):
    shown = {thing.id: count for thing, count in zip(true_cars, [9, 5, 4, 7, 6, 12], strict=True)}
    case = write_truth(true_cars, shown)
    estimates = [
        moved(thing, i, rng.normal(0, 0.15, 3), rng.normal(0, 0.05), rng.uniform(0.95, 1.05))
        for i, thing in enumerate(true_cars[:4])
    ]
    estimates.append(moved(true_cars[4], 50, (0.2, 0.1, 0.0), np.pi - 0.1))  # the wrong way round
    estimates.append(make_car(60, [60.0, 0.0, 0.8]))  # nobody's
    run = write_run(estimates)
    ours, theirs = evaluate_run(case, run), score_run.score_objects(case, run, 5, False)
    assert theirs["true"] == 5
    assert theirs["yaw_flipped"] == 1
    assert ours["voxel_iou_mean"] == pytest.approx(theirs["voxel_iou_mean_all"], abs=1e-6)
    for key in ("recall", "centre_error_median_m", "yaw_error_median_deg"):
        assert ours[key] == pytest.approx(theirs[key], abs=1e-6)


def test_the_truth_itself_is_perfect(true_cars):
    found = figures_of(true_cars, true_cars)
    assert found["voxel_iou_mean"] == found["recall"] == 1.0
    assert found["centre_error_median_m"] < 1e-9
    assert found["yaw_error_median_deg"] < 1e-9
    assert 0.3 < found["voxel_iou_category_model"] < 0.95


def test_the_category_model_is_scored_at_the_estimated_pose(make_car, car):
    mean = make_car(1, [5.0, 1.0, 0.8], 0.3, z=np.zeros(len(car.modes)))
    worse = moved(mean, 1, scale=0.8)
    score = score_object(mean, worse)
    assert score.category_voxel_iou == pytest.approx(1.0)
    assert score.voxel_iou == pytest.approx(0.8**3, abs=0.03)


def test_a_missed_car_counts_as_nothing(true_cars):
    found = figures_of(true_cars, true_cars[:4])
    assert found["recall"] == found["voxel_iou_mean"] == pytest.approx(4 / 6)
    none = figures_of(true_cars, [])
    assert none == {"voxel_iou_mean": 0.0, "recall": 0.0, "voxel_iou_category_model": 0.0}


def test_objects_too_far_apart_are_not_matched(true_cars):
    for distance, pairs in ((MATCH_DISTANCE_M - 1e-3, 1), (MATCH_DISTANCE_M + 1e-3, 0)):
        estimate = moved(true_cars[0], 1, (0, 0, distance))
        assert len(match_objects(Map((true_cars[0],)), Map((estimate,)))) == pairs


def test_each_estimate_is_matched_once(true_cars):
    twice = [moved(true_cars[0], 1, (0.5, 0, 0)), moved(true_cars[0], 2, (0.2, 0, 0))]
    pairs = match_objects(Map(tuple(true_cars)), Map(tuple(twice)))
    assert [(t.id, e.id) for t, e in pairs] == [(true_cars[0].id, 2)]


def test_only_cars_seen_often_enough_count(true_cars):
    ids = [thing.id for thing in true_cars]
    objects = Map(tuple(true_cars))
    for counts, expected in (([9, 5, 4, 0, 1, 6], {0, 1, 5}), ([3, 2, 3, 0, 0, 0], {0, 2}), ([0] * 6, set(range(6)))):
        numbers = [n for n, count in zip(ids, counts, strict=True) for _ in range(count)]
        counted = counted_objects(Truth(objects, dict(enumerate(numbers)), None))
        assert counted == {ids[i] for i in expected}
    assert counted_objects(Truth(objects, None, None)) == set(ids)


def test_errors_are_those_that_were_put_in(make_car, rng):
    for _ in range(10):
        true = make_car(1, rng.normal(size=3), rng.uniform(-3, 3))
        shift, yaw = rng.uniform(-1, 1, 3), rng.uniform(-3, 3)
        score = score_object(true, moved(true, 2, shift, yaw))
        assert score.centre_error_m == pytest.approx(np.linalg.norm(shift))
        assert score.yaw_error_deg == pytest.approx(abs(np.degrees(yaw)))
