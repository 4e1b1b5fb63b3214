"""A finished run against the truth that lies beside its sequence."""

from __future__ import annotations

from pathlib import Path

from meshslam.evaluation.objects import object_figures
from meshslam.evaluation.path_pairs import pair_paths
from meshslam.evaluation.trajectories import absolute_errors_m, trajectory_figures
from meshslam.evaluation.truth import read_truth
from meshslam.maps import Map, Trajectory

_GIVEN_M = 2e-6  # files round to a micrometre


def evaluate_run(sequence_folder: Path, run_folder: Path) -> dict[str, float]:
    """The figures of metrics.json that need truth; empty without any.

    Objects are scored where there are objects.json and map.json, the path where there are groundtruth.tum and
    trajectory.tum. A path whose positions are the true ones to the last digit was given, as to `map`, and not found: it
    is not scored. MeshslamError, naming the file, if a file is damaged.
    """
    truth = read_truth(Path(sequence_folder))
    figures: dict[str, float] = {}
    if truth.objects is not None and (run_folder / "map.json").is_file():
        figures |= object_figures(truth, Map.load(run_folder))
    if truth.path is not None and (run_folder / "trajectory.tum").is_file():
        path = Trajectory.load(run_folder / "trajectory.tum")
        figures |= {} if _was_given(truth.path, path) else trajectory_figures(truth.path, path)
    return figures


def _was_given(truth: Trajectory, path: Trajectory) -> bool:
    pair = pair_paths(truth, path)
    return bool(len(pair)) and float(absolute_errors_m(pair).max()) < _GIVEN_M
