"""SLAM at the camera's rate."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.live.config import LiveConfig
    from meshslam.live.replaying import replay
    from meshslam.live.results import LiveCounts, LivePose
    from meshslam.live.slam import LiveSlam
else:
    __getattr__ = deferred(
        __name__,
        {
            "config": "LiveConfig",
            "replaying": "replay",
            "results": "LiveCounts LivePose",
            "slam": "LiveSlam",
        },
    )

__all__ = ["LiveConfig", "LiveCounts", "LivePose", "LiveSlam", "replay"]
