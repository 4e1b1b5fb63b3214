"""What messages are to us, by their types."""

from __future__ import annotations

from typing import Literal

Kind = Literal["image", "camera", "imu", "poses", "transforms"]

_FOXGLOVE: dict[str, Kind] = {
    "RawImage": "image",
    "CompressedImage": "image",
    "CompressedVideo": "image",
    "CameraCalibration": "camera",
    "PoseInFrame": "poses",
    "FrameTransform": "transforms",
    "FrameTransforms": "transforms",
}
KINDS: dict[str, Kind] = {
    "sensor_msgs/msg/Image": "image",
    "sensor_msgs/msg/CompressedImage": "image",
    "sensor_msgs/msg/CameraInfo": "camera",
    "sensor_msgs/msg/Imu": "imu",
    "nav_msgs/msg/Odometry": "poses",
    "geometry_msgs/msg/PoseStamped": "poses",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "poses",
    "geometry_msgs/msg/TransformStamped": "poses",
    "tf2_msgs/msg/TFMessage": "transforms",
    "tf/msg/tfMessage": "transforms",
    **{f"foxglove.{name}": kind for name, kind in _FOXGLOVE.items()},
    **{f"foxglove_msgs/msg/{name}": kind for name, kind in _FOXGLOVE.items()},
}
