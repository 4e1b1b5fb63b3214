"""How motion starts: gravity, velocity, scale, and the world in which motion is estimated."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.initialization.box_start import RoughStart, rough_start, rough_start_by_images
    from meshslam.initialization.config import EstimationConfig, UnknownStartConfig
    from meshslam.initialization.first_frames import FirstFrames
    from meshslam.initialization.gravity_alignment import AlignmentConfig
    from meshslam.initialization.settling import Estimator, Settled, Settling, settled, settling_seconds, unknown_start
    from meshslam.initialization.world_alignment import (
        Path,
        level_from_world,
        moved_map,
        moved_path,
        moved_sequence,
        world_from_levelled,
    )
else:
    __getattr__ = deferred(
        __name__,
        {
            "box_start": "RoughStart rough_start rough_start_by_images",
            "config": "EstimationConfig UnknownStartConfig",
            "first_frames": "FirstFrames",
            "gravity_alignment": "AlignmentConfig",
            "settling": "Estimator Settled Settling settled settling_seconds unknown_start",
            "world_alignment": "Path level_from_world moved_map moved_path moved_sequence world_from_levelled",
        },
    )

__all__ = [
    "AlignmentConfig",
    "EstimationConfig",
    "Estimator",
    "FirstFrames",
    "Path",
    "RoughStart",
    "Settled",
    "Settling",
    "UnknownStartConfig",
    "level_from_world",
    "moved_map",
    "moved_path",
    "moved_sequence",
    "rough_start",
    "rough_start_by_images",
    "settled",
    "settling_seconds",
    "unknown_start",
    "world_from_levelled",
]
