"""Corners and the road's texture as measurements of the camera's motion."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.features.camera_lengths import Lengths, correct_lengths
    from meshslam.features.camera_rotations import RotationConfig, correct_rotations
    from meshslam.features.image_features import FeatureTracker, FrameFeatures, FrameImage, ImageFeatures
    from meshslam.features.length_config import LengthConfig
    from meshslam.features.length_evidence import LogFactor
    from meshslam.features.point_tracks import PointConfig, PointTracks
    from meshslam.features.road_displacement import RoadConfig, road_displacement_m, road_normal
    from meshslam.features.two_view_motion import two_views
else:
    __getattr__ = deferred(
        __name__,
        {
            "camera_lengths": "Lengths correct_lengths",
            "camera_rotations": "RotationConfig correct_rotations",
            "image_features": "FeatureTracker FrameFeatures FrameImage ImageFeatures",
            "length_config": "LengthConfig",
            "length_evidence": "LogFactor",
            "point_tracks": "PointConfig PointTracks",
            "road_displacement": "RoadConfig road_displacement_m road_normal",
            "two_view_motion": "two_views",
        },
    )

__all__ = [
    "FeatureTracker",
    "FrameFeatures",
    "FrameImage",
    "ImageFeatures",
    "LengthConfig",
    "Lengths",
    "LogFactor",
    "PointConfig",
    "PointTracks",
    "RoadConfig",
    "RotationConfig",
    "correct_lengths",
    "correct_rotations",
    "road_displacement_m",
    "road_normal",
    "two_views",
]
