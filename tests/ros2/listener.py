"""A process that listens to the node, and writes what it heard as JSON when its standard input is closed.

python -m tests.ros2.listener OUT.json
"""

import json
import select
import sys
import time
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from rclpy.qos import DurabilityPolicy, QoSProfile
from visualization_msgs.msg import Marker, MarkerArray


def ns(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


class Heard:
    """All that came."""

    def __init__(self):
        self.odometry, self.path, self.diagnostics, self.objects, self.messages = [], 0, {}, {}, 0
        self.log = []

    def on_odometry(self, m):
        p, q = m.pose.pose.position, m.pose.pose.orientation
        v, w = m.twist.twist.linear, m.twist.twist.angular
        self.odometry.append(
            {
                "ns": ns(m.header.stamp),
                "frames": [m.header.frame_id, m.child_frame_id],
                "pose": [p.x, p.y, p.z, q.x, q.y, q.z, q.w],
                "covariance": [float(c) for c in m.pose.covariance],
                "twist": [v.x, v.y, v.z, w.x, w.y, w.z],
                "arrived_s": time.time(),
            }
        )

    def on_path(self, m):
        self.path = len(m.poses)

    def on_objects(self, m):
        self.messages += 1
        for marker in m.markers:
            if marker.action == Marker.DELETEALL:
                self.objects.clear()
                self.log.append("all deleted")
            elif marker.action == Marker.DELETE:
                self.objects.pop(f"{marker.ns} {marker.id}", None)
                self.log.append(f"deleted {marker.id}")
            else:
                name = f"{marker.ns} {marker.id}"
                if name not in self.objects:
                    print(name, flush=True)
                self.objects[name] = len(marker.points)

    def on_diagnostics(self, m):
        for status in m.status:
            values = {v.key: v.value for v in status.values}
            self.diagnostics[status.name] = [ord(status.level), status.message, values]
            if ord(status.level) and status.message not in self.log:
                self.log.append(status.message)


def main():
    out, heard = Path(sys.argv[1]), Heard()
    rclpy.init()
    node = rclpy.create_node("listener")
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(Odometry, "/meshslam/odometry", heard.on_odometry, 1000)
    node.create_subscription(PathMessage, "/meshslam/path", heard.on_path, latched)
    node.create_subscription(
        MarkerArray, "/meshslam/objects", heard.on_objects, 100 if "--volatile" in sys.argv else latched
    )
    node.create_subscription(DiagnosticArray, "/diagnostics", heard.on_diagnostics, 100)
    print("listening", flush=True)
    while not select.select([sys.stdin], [], [], 0)[0]:
        rclpy.spin_once(node, timeout_sec=0.1)
    out.write_text(json.dumps(vars(heard)))
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
