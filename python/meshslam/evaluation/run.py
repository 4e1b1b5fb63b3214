"""A finished run against the truth that lies beside its sequence."""

from __future__ import annotations

from pathlib import Path

from meshslam.evaluation.objects import object_figures
from meshslam.evaluation.trajectories import trajectory_figures
from meshslam.evaluation.truth import read_truth
from meshslam.maps import Map, Trajectory


def evaluate_run(sequence_folder: Path, run_folder: Path) -> dict[str, float]:
    """The figures of metrics.json that need truth; empty without any.

    Objects are scored where there are objects.json and map.json, the path where there are groundtruth.tum and
    trajectory.tum. MeshslamError, naming the file, if one of them is damaged.
    """
    truth = read_truth(Path(sequence_folder))
    figures: dict[str, float] = {}
    if truth.objects is not None and (run_folder / "map.json").is_file():
        figures |= object_figures(truth, Map.load(run_folder))
    if truth.path is not None and (run_folder / "trajectory.tum").is_file():
        figures |= trajectory_figures(truth.path, Trajectory.load(run_folder / "trajectory.tum"))
    return figures
