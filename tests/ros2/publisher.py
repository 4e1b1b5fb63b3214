"""A process that publishes a recording on ROS topics, by its clock, as drivers do; with what goes wrong with drivers.

python -m tests.ros2.publisher FOLDER [--rate 1] [--from S] [--to S] [--shift-s N] [--compressed] [--reliable] …
"""

import argparse
import array
import time
from pathlib import Path

import cv2
import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu
from std_msgs.msg import Header

import meshslam


def header(time_s, frame):
    ns = round(time_s * 1e9)
    return Header(stamp=Time(sec=ns // 10**9, nanosec=ns % 10**9), frame_id=frame)


def image_message(image, time_s, encoding="bgr8", padding=0):
    """An Image; `padding` bytes follow each row."""
    values = image if encoding == "bgr8" else image[..., ::-1] if encoding == "rgb8" else image[..., 0]
    rows = np.ascontiguousarray(values).reshape(len(image), -1)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    message = Image(header=header(time_s, "camera_optical"), encoding=encoding, is_bigendian=0)
    message.height, message.width, message.step = image.shape[0], image.shape[1], rows.shape[1]
    message.data = array.array("B", rows.tobytes())
    return message


def compressed_message(image, time_s):
    data = cv2.imencode(".png", image)[1].tobytes()
    return CompressedImage(header=header(time_s, "camera_optical"), format="png", data=array.array("B", data))


def info_message(camera, time_s, coefficients=(0.0,) * 5):
    k = np.array([[camera.fx, camera.skew, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    p = np.concatenate([k, np.zeros((3, 1))], axis=1)
    return CameraInfo(
        header=header(time_s, "camera_optical"),
        height=camera.height,
        width=camera.width,
        distortion_model="plumb_bob",
        d=[float(v) for v in coefficients],
        k=[float(v) for v in k.ravel()],
        r=[float(v) for v in np.eye(3).ravel()],
        p=[float(v) for v in p.ravel()],
    )


def imu_message(imu, index, shift_s):
    message = Imu(header=header(float(imu.times_s[index]) + shift_s, "imu"))
    message.orientation_covariance[0] = -1.0
    pairs = ((message.angular_velocity, imu.angular_rate_rad_s), (message.linear_acceleration, imu.specific_force_m_s2))
    for vector, values in pairs:
        vector.x, vector.y, vector.z = (float(v) for v in values[index])
    return message


def arguments():
    parser = argparse.ArgumentParser()
    parser.add_argument("recording", type=Path)
    parser.add_argument("--imu-file", type=Path)
    parser.add_argument("--imu-from-camera", type=Path)
    parser.add_argument("--rate", type=float, default=1.0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--last", type=int, default=10**9)
    parser.add_argument("--shift-s", type=float, default=1_700_000_000.0, help="added to the recording's times")
    parser.add_argument("--compressed", action="store_true")
    parser.add_argument("--encoding", default="mono8")
    parser.add_argument("--padding", type=int, default=0)
    parser.add_argument("--reliable", action="store_true")
    parser.add_argument("--clock", action="store_true")
    parser.add_argument("--latched-info", action="store_true")
    parser.add_argument("--drop", type=int, default=0, help="every n-th image is lost")
    parser.add_argument("--swap", type=int, default=0, help="every n-th image comes after the next one")
    parser.add_argument("--late-s", type=float, default=0.0, help="every third image comes so late")
    parser.add_argument("--imu-gap", type=float, nargs=2, default=(0.0, 0.0), help="seconds since the first frame")
    parser.add_argument("--no-info", action="store_true")
    parser.add_argument("--wait-for", type=int, default=1, help="subscribers of the images")
    parser.add_argument("--linger-s", type=float, default=0.5)
    return parser.parse_args()


def schedule(recording, told):
    """What is published when: (seconds after the first frame, kind, index), in order."""
    times = recording.times_s - recording.times_s[0]
    frames = range(told.first, min(told.last, len(times)))
    rows = []
    for i in frames:
        at = float(times[i])
        if told.drop and i % told.drop == told.drop - 1:
            continue
        if told.swap and i % told.swap == told.swap - 1 and i + 1 < len(times):
            at = float(times[i + 1]) + 0.005
        if told.late_s and i % 3 == 2:
            at += told.late_s
        rows.append((at, "image", i))
    begin, end = float(times[frames[0]]), float(times[frames[-1]])
    if recording.imu is not None:
        since = recording.imu.times_s - recording.times_s[0]
        gap = told.imu_gap
        chosen = np.flatnonzero((since > begin - 0.3) & (since < end + 0.3) & ~((since > gap[0]) & (since < gap[1])))
        rows += [(float(since[i]), "imu", int(i)) for i in chosen]
    return sorted(rows)


def main():
    told = arguments()
    recording = meshslam.open_sequence(told.recording, imu=told.imu_file, imu_from_camera=told.imu_from_camera)
    images = {
        i: recording.images.read(i, None) for i in range(told.first, min(told.last, len(recording.times_s)))
    }  # from disk before the clock runs
    rclpy.init()
    node = rclpy.create_node("drivers")
    profile = QoSProfile(
        depth=2000, reliability=ReliabilityPolicy.RELIABLE if told.reliable else ReliabilityPolicy.BEST_EFFORT
    )
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    kind, topic = (CompressedImage, "/camera/image_raw/compressed") if told.compressed else (Image, "/camera/image_raw")
    image_out = node.create_publisher(kind, topic, profile)
    imu_out = node.create_publisher(Imu, "/imu", profile)
    info_out = node.create_publisher(CameraInfo, "/camera/camera_info", latched if told.latched_info else profile)
    clock_out = node.create_publisher(Clock, "/clock", 10) if told.clock else None
    raw = recording.raw_camera
    lens = (0.0,) * 5 if recording.distortion is None else recording.distortion.coefficients
    shift_s = told.shift_s + float(recording.times_s[0])
    if told.latched_info and not told.no_info:
        info_out.publish(info_message(raw, shift_s, lens))
    until_s = time.monotonic() + 30
    while image_out.get_subscription_count() < told.wait_for or imu_out.get_subscription_count() < told.wait_for:
        assert time.monotonic() < until_s, "nobody subscribed"
        if not told.no_info and not told.latched_info:
            info_out.publish(info_message(raw, shift_s, lens))
        time.sleep(0.05)
    rows = schedule(recording, told)
    began_s, first_s = time.monotonic() + 0.3, rows[0][0]
    for at, what, index in rows:
        left_s = began_s + (at - first_s) / told.rate - time.monotonic()
        if left_s > 0:
            time.sleep(left_s)
        time_s = float(recording.times_s[index]) + told.shift_s if what == "image" else None
        if what == "imu":
            imu_out.publish(imu_message(recording.imu, index, told.shift_s))
            continue
        if clock_out is not None:
            clock_out.publish(Clock(clock=header(time_s, "").stamp))
        if not told.no_info and not told.latched_info:
            info_out.publish(info_message(raw, time_s, lens))
        image = images[index]
        made = (
            compressed_message(image, time_s)
            if told.compressed
            else image_message(image, time_s, told.encoding, told.padding)
        )
        image_out.publish(made)
        print(f"image {index} {time_s:.9f}", flush=True)
    time.sleep(told.linger_s)
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
