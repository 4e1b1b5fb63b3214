"""How motion starts: gravity, velocity, scale, and the world in which motion is estimated."""

from meshslam.initialization.box_start import RoughStart, rough_start, rough_start_by_images
from meshslam.initialization.config import EstimationConfig, UnknownStartConfig
from meshslam.initialization.first_frames import FirstFrames
from meshslam.initialization.gravity_alignment import AlignmentConfig
from meshslam.initialization.settling import Estimator, Settled, settled, settling_seconds, unknown_start
from meshslam.initialization.world_alignment import (
    Path,
    level_from_world,
    moved_map,
    moved_path,
    moved_sequence,
    world_from_levelled,
)

__all__ = [
    "AlignmentConfig",
    "EstimationConfig",
    "Estimator",
    "FirstFrames",
    "Path",
    "RoughStart",
    "Settled",
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
