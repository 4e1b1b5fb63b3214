"""Camera and objects in one graph."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.object_slam.config import SlamConfig
    from meshslam.object_slam.estimator import SlamEstimator
    from meshslam.object_slam.joint_gradient import joint_descent
    from meshslam.object_slam.landmarks import joined_tracks
    from meshslam.object_slam.local_mapping import SlamLocalMapping
    from meshslam.object_slam.loop_closure import LoopClosureConfig
    from meshslam.object_slam.result import SlamResult, SlamState
    from meshslam.object_slam.sequence import path_alone, slam_sequence, world_of
    from meshslam.object_slam.slam import Slam, SlamParts, SlamSettings
    from meshslam.object_slam.start import StreamFrame
else:
    __getattr__ = deferred(
        __name__,
        {
            "config": "SlamConfig",
            "estimator": "SlamEstimator",
            "joint_gradient": "joint_descent",
            "landmarks": "joined_tracks",
            "local_mapping": "SlamLocalMapping",
            "loop_closure": "LoopClosureConfig",
            "result": "SlamResult SlamState",
            "sequence": "path_alone slam_sequence world_of",
            "slam": "Slam SlamParts SlamSettings",
            "start": "StreamFrame",
        },
    )

__all__ = [
    "LoopClosureConfig",
    "Slam",
    "SlamConfig",
    "SlamEstimator",
    "SlamLocalMapping",
    "SlamParts",
    "SlamResult",
    "SlamSettings",
    "SlamState",
    "StreamFrame",
    "joined_tracks",
    "joint_descent",
    "path_alone",
    "slam_sequence",
    "world_of",
]
