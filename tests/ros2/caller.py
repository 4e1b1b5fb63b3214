"""A process that calls a service of the node: python -m tests.ros2.caller reset | localize true."""

import json
import sys

import rclpy
from std_srvs.srv import SetBool, Trigger


def main():
    name, *data = sys.argv[1:]
    kind = SetBool if data else Trigger
    rclpy.init()
    node = rclpy.create_node("caller")
    client = node.create_client(kind, f"/meshslam/{name}")
    assert client.wait_for_service(timeout_sec=20), "no such service"
    future = client.call_async(kind.Request(data=data == ["true"]) if data else kind.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=60)
    answer = future.result()
    print(json.dumps([answer.success, answer.message]))
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
