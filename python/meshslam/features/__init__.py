"""Corners and the road's texture as measurements of the camera's motion."""

from meshslam.features.camera_rotations import RotationConfig, correct_rotations
from meshslam.features.image_features import FrameImage, ImageFeatures
from meshslam.features.point_tracks import PointConfig, PointTracks
from meshslam.features.road_displacement import RoadConfig, road_displacement_m, road_normal
from meshslam.features.two_view_motion import two_views

__all__ = [
    "FrameImage",
    "ImageFeatures",
    "PointConfig",
    "PointTracks",
    "RoadConfig",
    "RotationConfig",
    "correct_rotations",
    "road_displacement_m",
    "road_normal",
    "two_views",
]
