"""What the node is told: the flags of `meshslam ros2`, which are its ROS parameters too."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from meshslam.errors import ConfigError


def _option(default: Any, doc: str) -> Any:  # noqa: ANN401 # a text, a number or a switch
    return field(default=default, metadata={"doc": doc})


@dataclass(frozen=True)
class NodeOptions:
    """The node's parameters: empty texts and 0.0 stand for what is not known or not wanted.

    Example:
        NodeOptions(image="/cam0/image_raw", imu="/imu0", imu_from_camera="camchain-imucam.yaml")

    """

    image: str = _option("/camera/image_raw", "topic of the images, Image or CompressedImage")
    imu: str = _option("", "topic of the IMU; empty: the images alone tell how the camera moves")
    camera_info: str = _option("", "topic of the camera's calibration; empty: camera_info beside the images")
    camera: str = _option("", "calibration file of the camera, instead of a topic")
    imu_from_camera: str = _option("", "file with the mounting of the IMU: 4x4, or Kalibr's camchain-imucam")
    imu_time_offset_s: float = _option(0.0, "seconds by which the IMU's clock is ahead of the camera's")
    camera_from_body: str = _option("", "file with camera_from_body (4x4): poses are the body's, else the camera's")
    height_above_ground_m: float = _option(0.0, "height of the camera above the ground; 0: not known")
    segmenter: str = _option("", "ONNX file, a name in the store of models, or colour: a simulated world's")
    adapter: str = _option("", "YAML file that says how the network is fed and read")
    classes: str = _option("", "classes that are others of ours: vehicle=car")
    category: str = _option("car", "category to map: a shipped one, or a file (.npz)")
    keypoints: bool = _option(True, "find key points of cars by the shipped network")
    config: str = _option("", "YAML file with settings, such as a run's config.yaml")
    map: str = _option("", "a run, or its map.json, to localize in; empty: SLAM")
    out: str = _option("run", "run directory that the map is saved to")
    overwrite: bool = _option(False, "replace the run that is in the run directory")
    refine: bool = _option(True, "at the end, smooth all and fit the meshes once more")
    map_frame: str = _option("map", "name of the map's frame (REP 105)")
    odom_frame: str = _option("odom", "name of the frame in which the path does not jump (REP 105)")
    body_frame: str = _option("base_link", "name of the body's frame, where camera_from_body is given")
    publish_tf: bool = _option(True, "publish /tf, where tf2_msgs is installed and camera_from_body is given")
    patience_s: float = _option(3.0, "seconds without a message until the node says so")
    objects_period_s: float = _option(1.0, "seconds from one look at the map for changed meshes to the next")
    path_period_s: float = _option(1.0, "seconds from one message of the path to the next, at least")

    def __post_init__(self) -> None:
        if not self.image:
            raise ConfigError("image: the topic of the images is empty: give --image /camera/image_raw")
        for name in ("patience_s", "objects_period_s", "path_period_s"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} is {getattr(self, name)}, expected seconds above 0")
        if self.height_above_ground_m < 0:
            raise ConfigError(f"height_above_ground_m is {self.height_above_ground_m}, expected metres from 0")
        if self.imu and not (self.imu_from_camera or self.camera):
            raise ConfigError(
                f"imu {self.imu}: how the IMU is mounted is not known: give --imu-from-camera FILE (4x4, or Kalibr's "
                "camchain-imucam), or leave out --imu"
            )
        if self.map and not self.imu:
            raise ConfigError("map: localizing needs an IMU: give --imu TOPIC and --imu-from-camera FILE")

    @property
    def camera_info_topic(self) -> str:
        """The topic of CameraInfo: as given, else beside the images, as ROS' drivers have it.

        >>> NodeOptions(image="/front/image_raw/compressed").camera_info_topic
        '/front/camera_info'
        """
        if self.camera_info:
            return self.camera_info
        raw = self.image.removesuffix("/compressed")
        return f"{raw.rpartition('/')[0]}/camera_info" if "/" in raw else "camera_info"


def option_docs() -> Mapping[str, tuple[object, str]]:
    """Default and description of each option, by its name."""
    return {one.name: (one.default, one.metadata["doc"]) for one in fields(NodeOptions)}


def checked_option(name: str, value: object) -> str | bool | float:
    """An option's value of its own type; ConfigError if it is of another: `-p overwrite:=3`."""
    default, _ = option_docs()[name]
    if isinstance(default, float) and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, str | bool) and isinstance(value, type(default)):
        return value
    kind = {str: "a text", bool: "true or false", float: "a number"}[type(default)]
    raise ConfigError(f"parameter {name} is {value!r:.60}, expected {kind}")
