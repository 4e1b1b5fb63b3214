"""Inertial odometry, localization in a map of meshes, joint SLAM."""

from meshslam.localization.config import (
    AssociationConfig,
    GateConfig,
    ImuConfig,
    LocalizationConfig,
    SlamConfig,
    SmootherConfig,
    StartConfig,
)
from meshslam.localization.inertial import inertial_path, start_state
from meshslam.localization.localizer import FrameReport, Localizer
from meshslam.localization.notes import imu_notes, object_notes
from meshslam.localization.run import Localization, SlamPath, localize, slam_path
from meshslam.localization.slam import Slam
from meshslam.localization.slam_system import SlamState, SlamSystem, SlamSystemConfig
from meshslam.localization.stream import Frame
from meshslam.localization.system import State, System, SystemConfig

__all__ = [
    "AssociationConfig",
    "Frame",
    "FrameReport",
    "GateConfig",
    "ImuConfig",
    "Localization",
    "LocalizationConfig",
    "Localizer",
    "Slam",
    "SlamConfig",
    "SlamPath",
    "SlamState",
    "SlamSystem",
    "SlamSystemConfig",
    "SmootherConfig",
    "StartConfig",
    "State",
    "System",
    "SystemConfig",
    "imu_notes",
    "inertial_path",
    "localize",
    "object_notes",
    "slam_path",
    "start_state",
]
