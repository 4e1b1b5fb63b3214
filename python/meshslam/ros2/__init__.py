"""The ROS 2 node (extra `ros2`): topics in, SLAM or localization behind, odometry and meshes out."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.ros2.options import NodeOptions, checked_option, option_docs
    from meshslam.ros2.running import run_node
    from meshslam.ros2.versions import check_ros2
else:
    __getattr__ = deferred(
        __name__,
        {
            "options": "NodeOptions checked_option option_docs",
            "running": "run_node",
            "versions": "check_ros2",
        },
    )

__all__ = ["NodeOptions", "check_ros2", "checked_option", "option_docs", "run_node"]
