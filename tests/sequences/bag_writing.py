"""Recordings as ROS 1 bags, ROS 2 bags and MCAP files, by rosbags' and MCAP's own writers."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from meshslam.geometry import Camera, Pose
from meshslam.sequences import ImuSamples

IMAGE, INFO, IMU, ODOMETRY = "/camera/image_raw", "/camera/camera_info", "/imu/data", "/odom"
OPTICAL, IMU_FRAME, BODY, WORLD = "camera_optical", "imu_link", "base_link", "odom"
START_NS = 1_700_000_000_000_000_000
RADTAN = (-0.2, 0.05, 0.001, -0.002, 0.0)


@dataclass
class Recorded:
    """What the bags of a test hold."""

    camera: Camera
    times_ns: list[int]
    images: list[np.ndarray]
    imu: ImuSamples
    world_from_body: list[Pose]
    camera_from_body: Pose
    imu_from_camera: Pose
    distortion: tuple[float, ...] = RADTAN


class Ros:
    """Builds the messages of ROS 1 or ROS 2."""

    def __init__(self, version: int) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.version = version
        self.types = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
        if version == 1:  # the store lacks it
            kind = "tf2_msgs/msg/TFMessage"
            self.types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", kind))

    def make(self, kind: str, **fields):
        return self.types.types[kind](**fields)

    def time(self, ns: int):
        return self.make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)

    def header(self, ns: int, frame: str):
        extra = {"seq": 0} if self.version == 1 else {}
        return self.make("std_msgs/msg/Header", stamp=self.time(ns), frame_id=frame, **extra)

    def image(self, ns: int, pixels: np.ndarray, encoding="bgr8", step=None, frame=OPTICAL, big=0, size=None):
        flat = np.ascontiguousarray(pixels)
        height, width = size or flat.shape[:2]
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(ns, frame),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=big,
            step=flat.nbytes // height if step is None else step,
            data=flat.view(np.uint8).ravel(),
        )

    def compressed(self, ns: int, content: bytes, form="bgr8; png compressed bgr8", frame=OPTICAL):
        data = np.frombuffer(content, np.uint8)
        kind = "sensor_msgs/msg/CompressedImage"
        return self.make(kind, header=self.header(ns, frame), format=form, data=data)

    def info(self, ns: int, camera: Camera, d=(), model="plumb_bob", k=None, p=None):
        matrix = camera.matrix.ravel() if k is None else np.array(k, float)
        projection = np.column_stack([camera.matrix, np.zeros(3)]).ravel() if p is None else np.array(p, float)
        roi = self.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        names = {"d": np.array(d, float), "k": matrix, "r": np.eye(3).ravel(), "p": projection}
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(ns, OPTICAL),
            height=camera.height,
            width=camera.width,
            distortion_model=model,
            binning_x=0,
            binning_y=0,
            roi=roi,
            **{(name.upper() if self.version == 1 else name): value for name, value in names.items()},
        )

    def vector(self, values):
        return self.make("geometry_msgs/msg/Vector3", **dict(zip("xyz", map(float, values), strict=True)))

    def imu(self, ns: int, rate, force):
        return self.make(
            "sensor_msgs/msg/Imu",
            header=self.header(ns, IMU_FRAME),
            orientation=self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=np.zeros(9),
            angular_velocity=self.vector(rate),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self.vector(force),
            linear_acceleration_covariance=np.zeros(9),
        )

    def quaternion(self, pose: Pose):
        values = Rotation.from_matrix(pose.rotation).as_quat()
        return self.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", map(float, values), strict=True)))

    def pose(self, pose: Pose):
        place = dict(zip("xyz", map(float, pose.translation), strict=True))
        point = self.make("geometry_msgs/msg/Point", **place)
        return self.make("geometry_msgs/msg/Pose", position=point, orientation=self.quaternion(pose))

    def odometry(self, ns: int, pose: Pose, child=BODY):
        twist = self.make("geometry_msgs/msg/Twist", linear=self.vector([0] * 3), angular=self.vector([0] * 3))
        return self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(ns, WORLD),
            child_frame_id=child,
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=self.pose(pose), covariance=np.zeros(36)),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )

    def pose_stamped(self, ns: int, pose: Pose):
        return self.make("geometry_msgs/msg/PoseStamped", header=self.header(ns, WORLD), pose=self.pose(pose))

    def transforms(self, ns: int, edges: Iterable[tuple[str, str, Pose]]):
        made = [
            self.make(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(ns, parent),
                child_frame_id=child,
                transform=self.make(
                    "geometry_msgs/msg/Transform",
                    translation=self.vector(pose.translation),
                    rotation=self.quaternion(pose),
                ),
            )
            for parent, child, pose in edges
        ]
        return self.make("tf2_msgs/msg/TFMessage", transforms=made)


@dataclass
class Said:
    """A message on a topic, written at a time."""

    topic: str
    log_ns: int
    message: object
    kind: str = field(default="")

    def __post_init__(self) -> None:
        self.kind = self.kind or getattr(self.message, "__msgtype__", "")


def said_of(ros: Ros, recorded: Recorded, image: Callable | None = None) -> list[Said]:
    """Everything of a recording, in the order of writing: images are written 5 ms late, poses are odometry."""
    image = image or ros.image
    body_from_camera = recorded.camera_from_body.inverse()
    edges = [
        (BODY, OPTICAL, body_from_camera),
        (BODY, IMU_FRAME, body_from_camera @ recorded.imu_from_camera.inverse()),
    ]
    found = [Said("/tf_static", START_NS, ros.transforms(0, edges))]
    for ns, pixels, pose in zip(recorded.times_ns, recorded.images, recorded.world_from_body, strict=True):
        found.append(Said(INFO, ns, ros.info(ns, recorded.camera, recorded.distortion)))
        found.append(Said(ODOMETRY, ns, ros.odometry(ns, pose)))
        found.append(Said(IMAGE, ns + 5_000_000, image(ns, pixels)))
    imu = recorded.imu
    for time_s, rate, force in zip(imu.times_s, imu.angular_rate_rad_s, imu.specific_force_m_s2, strict=True):
        ns = round(time_s * 1e9)
        found.append(Said(IMU, ns, ros.imu(ns, rate, force)))
    return sorted(found, key=lambda said: said.log_ns)


def png_of(ros: Ros) -> Callable:
    return lambda ns, pixels: ros.compressed(ns, cv2.imencode(".png", pixels)[1].tobytes())


def write_ros1(path: Path, ros: Ros, said: list[Said], compression: str = "") -> Path:
    from rosbags.rosbag1 import Writer

    writer = Writer(path)
    if compression:
        writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        topics = {s.topic: s.kind for s in said}
        connections = {t: writer.add_connection(t, kind, typestore=ros.types) for t, kind in topics.items()}
        for s in said:
            writer.write(connections[s.topic], s.log_ns, ros.types.serialize_ros1(s.message, s.kind))
    return path


def write_ros2(path: Path, ros: Ros, said: list[Said], storage="SQLITE3", mode="NONE") -> Path:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage])
    if mode != "NONE":
        writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        topics = {s.topic: s.kind for s in said}
        connections = {t: writer.add_connection(t, kind, typestore=ros.types) for t, kind in topics.items()}
        for s in said:
            writer.write(connections[s.topic], s.log_ns, ros.types.serialize_cdr(s.message, s.kind))
    return path


def write_mcap(path: Path, ros: Ros, said: list[Said], *, chunk_size=4096, **options) -> Path:
    """By MCAP's writer, with ROS messages."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk_size, **options)
        writer.start("ros1" if ros.version == 1 else "ros2")
        channels: dict[str, int] = {}
        for s in said:
            if s.topic not in channels:
                channels[s.topic] = _channel(writer, ros, s)
            write = ros.types.serialize_ros1 if ros.version == 1 else ros.types.serialize_cdr
            content = bytes(write(s.message, s.kind))
            writer.add_message(channels[s.topic], s.log_ns, content, s.log_ns)
        writer.finish()
    return path


def _channel(writer, ros: Ros, said: Said) -> int:
    text, _ = ros.types.generate_msgdef(said.kind, ros_version=ros.version)
    name = said.kind.replace("/msg/", "/") if ros.version == 1 else said.kind
    schema = writer.register_schema(name, f"ros{ros.version}msg", text.encode())
    return writer.register_channel(said.topic, "ros1" if ros.version == 1 else "cdr", schema)


def foxglove_of(recorded: Recorded) -> list[tuple[str, str, int, dict]]:
    """Topic, schema, time, fields: PNG images, the calibration, and the camera's way as frame transforms."""
    found = []
    body_from_camera = recorded.camera_from_body.inverse()
    for ns, pixels, pose in zip(recorded.times_ns, recorded.images, recorded.world_from_body, strict=True):
        image = {"frame_id": OPTICAL, "data": cv2.imencode(".png", pixels)[1].tobytes(), "format": "png"}
        camera = recorded.camera
        info = {
            "frame_id": OPTICAL,
            "width": camera.width,
            "height": camera.height,
            "distortion_model": "plumb_bob",
            "D": list(recorded.distortion),
            "K": camera.matrix.ravel().tolist(),
            "R": np.eye(3).ravel().tolist(),
            "P": np.column_stack([camera.matrix, np.zeros(3)]).ravel().tolist(),
        }
        found.append(("/camera/info", "CameraCalibration", ns, info))
        found.append(("/camera/image", "CompressedImage", ns, image))
        for parent, child, moved in ((WORLD, BODY, pose), (BODY, OPTICAL, body_from_camera)):
            place = dict(zip("xyz", moved.translation.tolist(), strict=True))
            turn = Rotation.from_matrix(moved.rotation).as_quat().tolist()
            fields = {"parent_frame_id": parent, "child_frame_id": child, "translation": place}
            fields["rotation"] = dict(zip("xyzw", turn, strict=True))
            found.append(("/tf", "FrameTransform", ns, fields))
    return found


def write_foxglove(path: Path, messages: list[tuple[str, str, int, dict]], encoding: str) -> Path:
    """By MCAP's writer, in Foxglove's schemas as Protocol Buffers or JSON."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file, chunk_size=4096)
        writer.start()
        channels: dict[str, int] = {}
        for topic, kind, ns, fields in messages:
            content, schema = (_protobuf if encoding == "protobuf" else _json)(kind, ns, fields)
            if topic not in channels:
                number = writer.register_schema(
                    f"foxglove.{kind}", "protobuf" if encoding == "protobuf" else "jsonschema", schema
                )
                channels[topic] = writer.register_channel(topic, encoding, number)
            writer.add_message(channels[topic], ns, content, ns)
        writer.finish()
    return path


def _json(kind: str, ns: int, fields: dict) -> tuple[bytes, bytes]:
    time = {"sec": ns // 10**9, "nsec": ns % 10**9}
    plain = {k: b64encode(v).decode() if isinstance(v, bytes) else v for k, v in fields.items()}
    return json.dumps({"timestamp": time, **plain}).encode(), b'{"type": "object"}'


def _protobuf(kind: str, ns: int, fields: dict) -> tuple[bytes, bytes]:
    from importlib import import_module

    from google.protobuf.timestamp_pb2 import Timestamp
    from mcap_protobuf.schema import build_file_descriptor_set

    made = getattr(import_module(f"foxglove_schemas_protobuf.{kind}_pb2"), kind)
    message = made(timestamp=Timestamp(seconds=ns // 10**9, nanos=ns % 10**9), **fields)
    return message.SerializeToString(), build_file_descriptor_set(made).SerializeToString()
