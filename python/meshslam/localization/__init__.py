"""Inertial odometry, localization in a map of meshes, joint SLAM."""

from meshslam.localization.config import (
    AssociationConfig,
    GateConfig,
    ImuConfig,
    LocalizationConfig,
    SmootherConfig,
    StartConfig,
)
from meshslam.localization.inertial import inertial_path, start_state
from meshslam.localization.localizer import FrameReport, Localizer
from meshslam.localization.run import Localization, localize

__all__ = [
    "AssociationConfig",
    "FrameReport",
    "GateConfig",
    "ImuConfig",
    "Localization",
    "LocalizationConfig",
    "Localizer",
    "SmootherConfig",
    "StartConfig",
    "inertial_path",
    "localize",
    "start_state",
]
