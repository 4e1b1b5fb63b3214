import numpy as np
import pytest

from meshslam.evaluation import evaluate_run, trajectory_figures
from meshslam.evaluation.path_pairs import nearest_in_time
from meshslam.geometry import Pose
from meshslam.maps import Trajectory


def noisy(path, rng, sigma=0.2):
    shifts = np.cumsum(rng.normal(0, sigma, (len(path), 3)), axis=0)
    poses = tuple(Pose(p.rotation, p.translation + s) for p, s in zip(path.world_from_camera, shifts, strict=True))
    return Trajectory(path.times_s, poses)


def test_figures_are_those_of_the_independent_tool(score_run, random_path, write_truth, write_run, rng):
    path = random_path()
    case, run = write_truth(path=path), write_run(path=noisy(path, rng))
    ours, theirs = evaluate_run(case, run), score_run.score_trajectory(case, run)
    assert set(ours) == {"ate_rmse_m", "end_error_percent"}
    for key, value in ours.items():
        assert value == pytest.approx(theirs[key], rel=1e-9)


def test_a_constant_shift_is_its_length(random_path, rng):
    path = random_path()
    for shift in rng.normal(size=(5, 3)):
        off = tuple(Pose(p.rotation, p.translation + shift) for p in path.world_from_camera)
        found = trajectory_figures(path, Trajectory(path.times_s, off))
        length = np.linalg.norm(np.diff(path.positions_in_world, axis=0), axis=1).sum()
        assert found["ate_rmse_m"] == pytest.approx(np.linalg.norm(shift))
        assert found["end_error_percent"] == pytest.approx(100 * np.linalg.norm(shift) / length)


def test_only_frames_with_an_estimate_count(random_path, rng):
    path = random_path(20)
    some = np.sort(rng.choice(20, 7, replace=False))
    part = Trajectory(path.times_s[some], tuple(path.world_from_camera[i] for i in some))
    assert trajectory_figures(path, part) == {"ate_rmse_m": 0.0, "end_error_percent": 0.0}
    late = Trajectory(path.times_s + 0.03, path.world_from_camera)
    assert trajectory_figures(path, late) == {}


def test_a_path_that_stands_still_has_no_end_error(random_path):
    path = random_path(5)
    still = Trajectory(path.times_s, (path.world_from_camera[0],) * 5)
    assert trajectory_figures(still, still) == {"ate_rmse_m": 0.0}


@pytest.mark.parametrize("count", [0, 1, 2, 30])
def test_nearest_in_time_is_the_nearest(rng, count):
    times, others = np.sort(rng.uniform(0, 1, 40)), np.sort(rng.uniform(0, 1, count))
    nearest, found = nearest_in_time(times, others)
    if not count:
        assert not found.any()
        return
    gaps = np.abs(times[:, None] - others[None])
    np.testing.assert_allclose(gaps[np.arange(40), nearest], gaps.min(axis=1))
    np.testing.assert_array_equal(found, gaps.min(axis=1) <= 5e-3)
