"""Drivers that do not go with the node: an IMU on the images' topic, best effort where reliable is asked for, no K."""

import time

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Imu


def main():
    rclpy.init()
    node = rclpy.create_node("wrong_drivers")
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    outlets = [
        node.create_publisher(Imu, "/camera/image_raw", 1),
        node.create_publisher(Imu, "/imu2", best_effort),
        node.create_publisher(CameraInfo, "/info", 1),
    ]
    while rclpy.ok():
        for outlet, kind in zip(outlets, (Imu, Imu, CameraInfo), strict=True):
            message = kind()
            message.header.stamp.sec = int(time.time())
            outlet.publish(message)
        time.sleep(0.1)


if __name__ == "__main__":
    main()
