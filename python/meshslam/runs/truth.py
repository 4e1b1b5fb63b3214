"""Paths of a run against the true one, which is opened once the run's own path is on disk."""

from __future__ import annotations

from collections.abc import Mapping

from meshslam.evaluation import read_truth, trajectory_figures
from meshslam.geometry import Pose
from meshslam.maps import Trajectory
from meshslam.sequences import Sequence


def paths_against_truth(recording: Sequence, paths: Mapping[str, tuple[Pose, ...] | Trajectory]) -> dict[str, float]:
    """`ate_<name>_rmse_m` of each path, its poses being those of the frames; empty without truth."""
    truth = read_truth(recording.root).path
    if truth is None:
        return {}
    found = {
        name: trajectory_figures(truth, path if isinstance(path, Trajectory) else Trajectory(recording.times_s, path))
        for name, path in paths.items()
        if len(path)
    }
    return {f"ate_{name}_rmse_m": rows["ate_rmse_m"] for name, rows in found.items() if "ate_rmse_m" in rows}


def true_path(recording: Sequence) -> dict[str, tuple[Pose, ...]]:
    """The true path under its name, to be drawn; empty where there is none."""
    truth = read_truth(recording.root).path
    return {} if truth is None else {"truth": truth.world_from_camera}
