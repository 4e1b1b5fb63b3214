"""Figures of finished runs: the only room that opens truth, after the map is on disk."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.evaluation.marked import MarkedScore, marked_labels, marked_objects, score_marked
    from meshslam.evaluation.masks import MaskScores, score_masks
    from meshslam.evaluation.objects import ObjectScore, match_objects, object_figures, score_object
    from meshslam.evaluation.run import evaluate_run
    from meshslam.evaluation.trajectories import nearest_in_time, trajectory_figures
    from meshslam.evaluation.truth import Truth, read_truth, truth_digest
else:
    __getattr__ = deferred(
        __name__,
        {
            "marked": "MarkedScore marked_labels marked_objects score_marked",
            "masks": "MaskScores score_masks",
            "objects": "ObjectScore match_objects object_figures score_object",
            "run": "evaluate_run",
            "trajectories": "nearest_in_time trajectory_figures",
            "truth": "Truth read_truth truth_digest",
        },
    )

__all__ = [
    "MarkedScore",
    "MaskScores",
    "ObjectScore",
    "Truth",
    "evaluate_run",
    "marked_labels",
    "marked_objects",
    "match_objects",
    "nearest_in_time",
    "object_figures",
    "read_truth",
    "score_marked",
    "score_masks",
    "score_object",
    "trajectory_figures",
    "truth_digest",
]
