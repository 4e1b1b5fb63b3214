"""The node's publishers: odometry, path, meshes, diagnostics, and /tf where there is tf2_msgs."""

from __future__ import annotations

import importlib.util
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.maps import Map
from meshslam.ros2 import messages
from meshslam.ros2.mesh_changes import ShownObjects
from meshslam.ros2.options import NodeOptions

_JOINED_S = 2.0
_BUNDLE = 25  # meshes in one message
_HISTORY = 20  # messages of meshes that are kept for those who join later
_PATH_STEP_M, _PATH_LENGTH = 0.1, 4000  # between poses of the path at first, and how many are too many


class Outlets:
    """Publishes; safe between threads."""

    def __init__(self, node: Any, options: NodeOptions, say: Callable[[str], None]) -> None:  # noqa: ANN401 # rclpy's
        """`node` is a rclpy Node; `say` warns of subscribers that cannot be served."""
        from diagnostic_msgs.msg import DiagnosticArray
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from nav_msgs.msg import Odometry, Path
        from rclpy.event_handler import PublisherEventCallbacks
        from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
        from rclpy.qos_overriding_options import QoSOverridingOptions
        from visualization_msgs.msg import MarkerArray

        self._options, self._lock, self._say = options, threading.RLock(), say
        self._mesh_lock = threading.Lock()  # meshes take long: odometry does not wait for them
        self._is_closed = False
        self._shown = ShownObjects()
        self._path: list[Any] = []
        self._path_step_m, self._path_end, self._path_has_news = _PATH_STEP_M, np.full(3, np.inf), False
        self._newest_ns = 0
        self._all_due_s: tuple[float, ...] = ()  # when all meshes are published, for those who joined

        def qos(depth: int, durability: Any) -> Any:  # noqa: ANN401 # rclpy's
            return QoSProfile(
                history=HistoryPolicy.KEEP_LAST,
                depth=depth,
                reliability=ReliabilityPolicy.RELIABLE,
                durability=durability,
            )

        def publisher(kind: Any, topic: str, profile: Any, matched: Any = None) -> Any:  # noqa: ANN401 # rclpy's
            def incompatible(event: Any) -> None:  # noqa: ANN401 # rclpy's
                say(f"{topic}: a subscriber asks for another QoS and gets nothing: {event.last_policy_kind}")

            return node.create_publisher(
                kind,
                topic,
                profile,
                event_callbacks=PublisherEventCallbacks(
                    incompatible_qos=incompatible, matched=matched, use_default_callbacks=False
                ),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )

        latched, volatile = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
        self._odometry = publisher(Odometry, "~/odometry", qos(50, volatile))
        self._pose = publisher(PoseWithCovarianceStamped, "~/pose", qos(50, volatile))
        self._path_out = publisher(Path, "~/path", qos(1, latched))
        self._objects = publisher(MarkerArray, "~/objects", qos(_HISTORY, latched), self._joined)
        self._diagnostics = publisher(DiagnosticArray, "/diagnostics", qos(10, volatile))
        self._tf = None
        if options.publish_tf and options.camera_from_body and importlib.util.find_spec("tf2_msgs") is not None:
            from tf2_msgs.msg import TFMessage

            self._tf = publisher(TFMessage, "/tf", qos(100, volatile))

    def _joined(self, event: Any) -> None:  # noqa: ANN401 # rclpy's
        if event.current_count_change > 0:  # it may know of us a little later than we of it: once more then
            now_s = time.monotonic()
            self._all_due_s = (now_s, now_s + _JOINED_S)

    def close(self) -> None:
        """Publish nothing more: the node goes."""
        with self._lock, self._mesh_lock:
            self._is_closed = True

    def pose(
        self,
        nanoseconds: int,
        child: str,
        world_from_child: Pose,
        map_from_odometry: Pose,
        covariance: Floats | None,
        twist: tuple[Floats, Floats] | None,
    ) -> None:
        """Publish odometry, the pose in the map, and /tf; add to the path."""
        frame, odom = self._options.map_frame, self._options.odom_frame
        odom_from_child = map_from_odometry.inverse() @ world_from_child
        with self._lock:
            if self._is_closed:
                return
            told = messages.odometry_message(odom, child, nanoseconds, odom_from_child, covariance, twist)
            self._odometry.publish(told)
            self._pose.publish(messages.sure_pose_message(frame, nanoseconds, world_from_child, covariance))
            self._newest_ns = max(self._newest_ns, nanoseconds)
            if self._tf is not None:
                from tf2_msgs.msg import TFMessage

                moved = [
                    messages.transform_message(frame, odom, nanoseconds, map_from_odometry),
                    messages.transform_message(odom, child, nanoseconds, odom_from_child),
                ]
                self._tf.publish(TFMessage(transforms=moved))
            self._lengthen(nanoseconds, world_from_child)

    def _lengthen(self, nanoseconds: int, pose: Pose) -> None:
        away_m = np.linalg.norm(pose.translation - self._path_end)
        if self._path and away_m < self._path_step_m:
            return
        self._path.append(messages.stamped_pose(self._options.map_frame, nanoseconds, pose))
        self._path_end, self._path_has_news = pose.translation, True
        if len(self._path) > _PATH_LENGTH:
            self._path, self._path_step_m = self._path[::2], 2 * self._path_step_m

    def path(self) -> None:
        """Publish the path, if it is longer than last time."""
        with self._lock:
            if self._is_closed or not self._path_has_news:
                return
            self._path_has_news = False
            self._path_out.publish(messages.path_message(self._options.map_frame, self._newest_ns, self._path))

    def objects(self, current: Map) -> int:
        """Publish meshes that changed, and what went; the number of meshes that were published.

        Those who join later get what the history holds, if they ask for it, and everything that is shown.
        """
        with self._mesh_lock:
            if self._is_closed:
                return 0
            changed, gone = self._shown.update(current)
            frame, now = self._options.map_frame, self._newest_ns
            if gone:
                deleted = [messages.deleted_marker(frame, now, *one) for one in gone]
                self._objects.publish(messages.marker_array(deleted))
            due_s = self._all_due_s
            self._all_due_s = tuple(s for s in due_s if s > time.monotonic())
            if len(self._all_due_s) < len(due_s):
                changed = list(self._shown.all())
            for first in range(0, len(changed), _BUNDLE):
                shown = [messages.object_marker(frame, now, thing) for thing in changed[first : first + _BUNDLE]]
                self._objects.publish(messages.marker_array(shown))
            return len(changed)

    def begin_anew(self) -> None:
        """Remove meshes and path."""
        with self._lock, self._mesh_lock:
            self._shown.forget()
            self._path, self._path_step_m, self._path_end = [], _PATH_STEP_M, np.full(3, np.inf)
            self._path_has_news = False
            if self._is_closed:
                return
            frame = self._options.map_frame
            self._objects.publish(messages.marker_array([messages.all_deleted_marker(frame, self._newest_ns)]))
            self._path_out.publish(messages.path_message(frame, self._newest_ns, []))

    def diagnostics(self, now_ns: int, statuses: Sequence[tuple[str, int, str, Mapping[str, object]]]) -> None:
        """Publish the node's state."""
        with self._lock:
            if not self._is_closed:
                self._diagnostics.publish(messages.diagnostic_array(now_ns, statuses))
