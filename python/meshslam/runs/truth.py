"""Paths of a run against the true one, which is opened once the run's own path is on disk."""

from __future__ import annotations

from meshslam.evaluation import read_truth, trajectory_figures
from meshslam.geometry import Pose
from meshslam.maps import Trajectory
from meshslam.sequences import Sequence


def paths_against_truth(recording: Sequence, paths: dict[str, tuple[Pose, ...]]) -> dict[str, float]:
    """`ate_<name>_rmse_m` of each path; empty without truth."""
    truth = read_truth(recording.root).path
    if truth is None:
        return {}
    found = {name: trajectory_figures(truth, Trajectory(recording.times_s, poses)) for name, poses in paths.items()}
    return {f"ate_{name}_rmse_m": rows["ate_rmse_m"] for name, rows in found.items() if "ate_rmse_m" in rows}


def true_path(recording: Sequence) -> dict[str, tuple[Pose, ...]]:
    """The true path under its name, to be drawn; empty where there is none."""
    truth = read_truth(recording.root).path
    return {} if truth is None else {"truth": truth.world_from_camera}
