"""The factor graph: window, factors, smoother, full-trajectory smoothing."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.graph.camera_prediction import CameraPrediction, PredictedCamera
    from meshslam.graph.checkpoint import Checkpoint, unchanged, unchanged_by_errors
    from meshslam.graph.config import SmootherConfig, StartConfig
    from meshslam.graph.drive_graph import DrivePrior, LaidDrives, ObjectInDrive, lay_drives
    from meshslam.graph.full_trajectory import Pair
    from meshslam.graph.graph_archive import Arrays
    from meshslam.graph.object_covariance import ObjectCovariance, moved_covariance
    from meshslam.graph.object_factor import ObservationCost, place_camera, small_rotation
    from meshslam.graph.smoother import FullTrajectory, Smoother
    from meshslam.graph.smoother_archive import smoother_from_arrays, smoother_to_arrays
    from meshslam.graph.start_factors import start_covariance
    from meshslam.graph.state_marginal import StateMarginal, begin_with, marginal_of
    from meshslam.graph.window import Entry
else:
    __getattr__ = deferred(
        __name__,
        {
            "camera_prediction": "CameraPrediction PredictedCamera",
            "checkpoint": "Checkpoint unchanged unchanged_by_errors",
            "config": "SmootherConfig StartConfig",
            "drive_graph": "DrivePrior LaidDrives ObjectInDrive lay_drives",
            "full_trajectory": "Pair",
            "graph_archive": "Arrays",
            "object_covariance": "ObjectCovariance moved_covariance",
            "object_factor": "ObservationCost place_camera small_rotation",
            "smoother": "FullTrajectory Smoother",
            "smoother_archive": "smoother_from_arrays smoother_to_arrays",
            "start_factors": "start_covariance",
            "state_marginal": "StateMarginal begin_with marginal_of",
            "window": "Entry",
        },
    )

__all__ = [
    "Arrays",
    "CameraPrediction",
    "Checkpoint",
    "DrivePrior",
    "Entry",
    "FullTrajectory",
    "LaidDrives",
    "ObjectCovariance",
    "ObjectInDrive",
    "ObservationCost",
    "Pair",
    "PredictedCamera",
    "Smoother",
    "SmootherConfig",
    "StartConfig",
    "StateMarginal",
    "begin_with",
    "lay_drives",
    "marginal_of",
    "moved_covariance",
    "place_camera",
    "small_rotation",
    "smoother_from_arrays",
    "smoother_to_arrays",
    "start_covariance",
    "unchanged",
    "unchanged_by_errors",
]
