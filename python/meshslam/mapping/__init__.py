"""Objects from their tracks: start, pose, shape; what moves or does not fit is left out and said so."""

from meshslam.mapping.camera_rotations import RotationConfig, correct_rotations
from meshslam.mapping.config import LeftOut, MappingConfig
from meshslam.mapping.frames import Frames
from meshslam.mapping.pipeline import Mapping, Stages, category_model, map_objects
from meshslam.mapping.work import Progress

__all__ = [
    "Frames",
    "LeftOut",
    "Mapping",
    "MappingConfig",
    "Progress",
    "RotationConfig",
    "Stages",
    "category_model",
    "correct_rotations",
    "map_objects",
]
