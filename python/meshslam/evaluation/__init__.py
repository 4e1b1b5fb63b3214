"""Figures of finished runs: the only room that opens truth, after the map is on disk."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.evaluation.marked import MarkedScore, marked_labels, marked_objects, score_marked
    from meshslam.evaluation.masks import MaskScores, score_masks
    from meshslam.evaluation.material import Material, MaterialParts, Options, UnavailableError
    from meshslam.evaluation.objects import ObjectScore, match_objects, object_figures, score_object
    from meshslam.evaluation.path_pairs import (
        TIME_TOLERANCE_S,
        PathPair,
        nearest_in_time,
        pair_paths,
        positions,
        umeyama,
    )
    from meshslam.evaluation.protocols import PROTOCOLS, Measured, Protocol, chosen_protocols, measure
    from meshslam.evaluation.results import ARROWS, FORMATS, formatted, short
    from meshslam.evaluation.run import evaluate_run
    from meshslam.evaluation.trajectories import absolute_errors_m, trajectory_figures
    from meshslam.evaluation.truth import Truth, read_truth, truth_digest
else:
    __getattr__ = deferred(
        __name__,
        {
            "marked": "MarkedScore marked_labels marked_objects score_marked",
            "masks": "MaskScores score_masks",
            "material": "Material MaterialParts Options UnavailableError",
            "objects": "ObjectScore match_objects object_figures score_object",
            "path_pairs": "TIME_TOLERANCE_S PathPair nearest_in_time pair_paths positions umeyama",
            "protocols": "PROTOCOLS Measured Protocol chosen_protocols measure",
            "results": "ARROWS FORMATS formatted short",
            "run": "evaluate_run",
            "trajectories": "absolute_errors_m trajectory_figures",
            "truth": "Truth read_truth truth_digest",
        },
    )

__all__ = [
    "ARROWS",
    "FORMATS",
    "PROTOCOLS",
    "TIME_TOLERANCE_S",
    "MarkedScore",
    "MaskScores",
    "Material",
    "MaterialParts",
    "Measured",
    "ObjectScore",
    "Options",
    "PathPair",
    "Protocol",
    "Truth",
    "UnavailableError",
    "absolute_errors_m",
    "chosen_protocols",
    "evaluate_run",
    "formatted",
    "marked_labels",
    "marked_objects",
    "match_objects",
    "measure",
    "nearest_in_time",
    "object_figures",
    "pair_paths",
    "positions",
    "read_truth",
    "score_marked",
    "score_masks",
    "score_object",
    "short",
    "trajectory_figures",
    "truth_digest",
    "umeyama",
]
