"""What comes in: subscriptions, and what their messages become."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from meshslam.geometry import Bytes
from meshslam.ros2.inputs import Images, InputState, camera_of_message, camera_values, imu_sample
from meshslam.ros2.options import NodeOptions
from meshslam.sequences import CameraFile, ImuSamples

_IMAGE_TYPES = {"sensor_msgs/msg/Image": "Image", "sensor_msgs/msg/CompressedImage": "CompressedImage"}
_IMAGES, _INFOS, _SAMPLES = 10, 10, 2000  # messages that wait for the node, at most
_LOOK_S = 0.25


class Inlets:
    """Images, IMU and calibration of their topics; called by the thread that spins."""

    def __init__(
        self,
        node: Any,  # noqa: ANN401 # rclpy's
        options: NodeOptions,
        camera: CameraFile | None,
        imu_ahead_s: float,
        on_imu: Callable[[ImuSamples], None],
        on_image: Callable[[Bytes, int], None],
    ) -> None:
        """`camera` is known from a file, or None. `on_image` gets undistorted images with their stamps in ns."""
        self._node, self._options, self._log = node, options, node.get_logger()
        self._ahead_s, self._on_imu, self._on_image = imu_ahead_s, on_imu, on_image
        self.camera, self._camera_is_given = camera, camera is not None
        self.images = InputState("images", node.resolve_topic_name(options.image))
        self._imu = InputState("IMU", node.resolve_topic_name(options.imu)) if options.imu else None
        self._info = None if camera else InputState("camera info", node.resolve_topic_name(options.camera_info_topic))
        self._decoder = Images(self.images)
        self._info_message: Any = None  # the newest, of which the next estimation takes the camera
        self._info_values: tuple[Any, ...] | None = None  # of the camera that is used
        self._image_type, self._is_reliable = "", False
        self._image_subscription: Any = None
        self._looked_s = float("-inf")
        self._subscribe()

    @property
    def states(self) -> list[InputState]:
        """What came on each topic."""
        return [state for state in (self._info, self.images, self._imu) if state is not None]

    def begin_anew(self) -> None:
        """Forget stamps, since the clock may have been set back; take the newest calibration, which may come once."""
        self.images.begin_anew()
        if self._imu is not None:
            self._imu.begin_anew()
        if not self._camera_is_given:
            self.camera = self._info_values = None
            if self._info_message is not None:
                self._take_info(self._info_message)

    def publishers(self, topic: str) -> list[tuple[str, str]]:
        """Type and node of each publisher of a topic."""
        infos = self._node.get_publishers_info_by_topic(topic)
        return [(str(info.topic_type), str(info.node_name)) for info in infos]

    def follow_images(self) -> None:
        """Subscribe to what is published on the images' topic: Image or CompressedImage.

        Images are large, and by best effort many are lost on the way: where every publisher is reliable, so are we.
        """
        if time.monotonic() - self._looked_s < _LOOK_S:
            return
        self._looked_s = time.monotonic()
        import sensor_msgs.msg
        from rclpy.qos import ReliabilityPolicy

        infos = self._node.get_publishers_info_by_topic(self.images.topic)
        types = [str(info.topic_type) for info in infos if str(info.topic_type) in _IMAGE_TYPES]
        reliable = all(info.qos_profile.reliability == ReliabilityPolicy.RELIABLE for info in infos)
        if not types or (self._image_type in types and reliable == self._is_reliable):
            return
        if self._image_subscription is not None:
            self._node.destroy_subscription(self._image_subscription)
        kind = getattr(sensor_msgs.msg, _IMAGE_TYPES[types[0]])
        self._image_type, self._is_reliable = types[0], reliable
        self._image_subscription = self._subscription(
            kind, self._options.image, self._take_image, _IMAGES, self.images, reliable=reliable
        )
        how = "reliable" if reliable else "best effort"
        self._log.info(f"images: {self.images.topic} is {types[0]}, {how}")

    def _subscribe(self) -> None:
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import CameraInfo, Imu

        if self._imu is not None:
            self._subscription(Imu, self._options.imu, self._take_imu, _SAMPLES, self._imu)
        if self._info is not None:
            self._subscription(CameraInfo, self._options.camera_info_topic, self._take_info, _INFOS, self._info)
            latched = QoSProfile(
                depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
            )
            self._quiet_subscription(CameraInfo, self._options.camera_info_topic, self._take_info, latched)

    def _subscription(  # rclpy's
        self,
        kind: Any,  # noqa: ANN401
        topic: str,
        call: Any,  # noqa: ANN401
        depth: int,
        state: InputState,
        *,
        reliable: bool = False,
    ) -> Any:  # noqa: ANN401
        """Best effort and volatile, as sensor data, unless reliable is wanted: it goes with every publisher."""
        from rclpy.event_handler import SubscriptionEventCallbacks
        from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
        from rclpy.qos_overriding_options import QoSOverridingOptions

        def incompatible(event: Any) -> None:  # noqa: ANN401 # rclpy's
            policy = str(event.last_policy_kind).rpartition(".")[2].removeprefix("RMW_QOS_POLICY_")
            state.problem = f"a publisher's QoS does not go with ours ({policy}): nothing comes from it"

        def lost(event: Any) -> None:  # noqa: ANN401 # rclpy's
            state.lost += int(event.total_count_change)

        wanted = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        profile = QoSProfile(depth=depth, history=HistoryPolicy.KEEP_LAST, reliability=wanted)
        return self._node.create_subscription(
            kind,
            topic,
            call,
            profile,
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=incompatible, message_lost=lost, use_default_callbacks=False
            ),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def _quiet_subscription(self, kind: Any, topic: str, call: Any, profile: Any) -> None:  # noqa: ANN401 # rclpy's
        """A second one, of those that publish once, for whoever joins later; with others it does not match."""
        from rclpy.event_handler import SubscriptionEventCallbacks

        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        self._node.create_subscription(kind, topic, call, profile, event_callbacks=quiet)

    def _take_info(self, message: Any) -> None:  # noqa: ANN401 # ROS'
        assert self._info is not None
        self._info_message = message
        if self.camera is not None:
            self._info.came(time.monotonic())
            self._info.why = ""
            if camera_values(message) != self._info_values:
                self._info.refuse("the calibration changed: the first is used; call ~/reset to use the new one")
            return
        found = camera_of_message(message, self.images.topic, self._info, time.monotonic())
        if found is not None:
            self.camera, self._info_values = found, camera_values(message)
            shown = found.camera
            lens = "" if found.distortion is None else ", distortion is removed"
            self._log.info(f"camera: {shown.width}x{shown.height}, focal length {shown.fx:.1f} px{lens}")

    def _take_imu(self, message: Any) -> None:  # noqa: ANN401 # ROS'
        assert self._imu is not None
        sample = imu_sample(message, self._imu, self._ahead_s, time.monotonic())
        if sample is not None:
            self._on_imu(sample)

    def _take_image(self, message: Any) -> None:  # noqa: ANN401 # ROS'
        read = self._decoder.read(message, self.camera, time.monotonic())
        if read is not None:
            self._on_image(*read)
