"""A ROS 2 bag (MCAP): odometry with covariances, path, transforms, and each car's mesh as a marker."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.geometry import Pose, quaternions_of_rotations
from meshslam.maps import MapObject, vertex_colours

WORLD, CAMERA = "map", "camera_optical"
UNKNOWN_VARIANCE = 1e6  # of what is not estimated: filters that read it give it no weight
TRIANGLE_LIST = 11  # visualization_msgs/Marker
VERSION = 9  # of the bag's metadata.yaml


def write(run: FinishedRun, target: Path) -> Notes:
    """Topics /meshslam/odometry, /meshslam/path, /meshslam/objects and /tf, stamped with the frames' times."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    maker = _Messages(get_typestore(Stores.ROS2_JAZZY))
    with Writer(target, version=VERSION, storage_plugin=StoragePlugin.MCAP) as writer:

        def put(topic: str, kind: str, messages: list[tuple[int, Any]]) -> None:
            connection = writer.add_connection(topic, kind, typestore=maker.store)
            for time_ns, message in messages:
                writer.write(connection, time_ns, maker.store.serialize_cdr(message, kind))

        times, poses = run.times_ns, run.path.world_from_camera
        covariances = run.covariances_in_world
        rows = list(enumerate(zip(times, poses, strict=True)))
        put(
            "/meshslam/odometry",
            "nav_msgs/msg/Odometry",
            [(t, maker.odometry(t, p, None if covariances is None else covariances[i])) for i, (t, p) in rows],
        )
        put("/tf", "tf2_msgs/msg/TFMessage", [(t, maker.transform(t, p)) for _, (t, p) in rows])
        if times:
            put("/meshslam/path", "nav_msgs/msg/Path", [(times[-1], maker.path(times, poses))])
            markers = [(times[0], maker.markers(times[0], run.scene.objects))]
            put("/meshslam/objects", "visualization_msgs/msg/MarkerArray", markers)
    return ()


class _Messages:
    """Makes messages of a distribution's types."""

    def __init__(self, store: Any) -> None:  # noqa: ANN401 # a Typestore of rosbags
        self.store = store

    def _new(self, name: str, **fields: Any) -> Any:  # noqa: ANN401 # a message
        package, kind = name.split("/")
        return self.store.types[f"{package}/msg/{kind}"](**fields)

    def header(self, time_ns: int, frame: str = WORLD) -> Any:  # noqa: ANN401
        seconds, rest = divmod(time_ns, 10**9)
        stamp = self._new("builtin_interfaces/Time", sec=seconds, nanosec=rest)
        return self._new("std_msgs/Header", stamp=stamp, frame_id=frame)

    def _vector(self, name: str, values: Any) -> Any:  # noqa: ANN401
        x, y, z = (float(value) for value in values)
        return self._new(f"geometry_msgs/{name}", x=x, y=y, z=z)

    def _quaternion(self, pose: Pose) -> Any:  # noqa: ANN401
        x, y, z, w = (float(value) for value in quaternions_of_rotations(pose.rotation[None])[0])
        return self._new("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)

    def pose(self, pose: Pose) -> Any:  # noqa: ANN401
        place = self._vector("Point", pose.translation)
        return self._new("geometry_msgs/Pose", position=place, orientation=self._quaternion(pose))

    def odometry(self, time_ns: int, pose: Pose, covariance: Any) -> Any:  # noqa: ANN401
        unknown = UNKNOWN_VARIANCE * np.eye(6)
        known = unknown if covariance is None else covariance
        zero = self._vector("Vector3", np.zeros(3))
        twist = self._new("geometry_msgs/Twist", linear=zero, angular=zero)
        return self._new(
            "nav_msgs/Odometry",
            header=self.header(time_ns),
            child_frame_id=CAMERA,
            pose=self._new("geometry_msgs/PoseWithCovariance", pose=self.pose(pose), covariance=known.ravel()),
            twist=self._new("geometry_msgs/TwistWithCovariance", twist=twist, covariance=unknown.ravel()),
        )

    def transform(self, time_ns: int, pose: Pose) -> Any:  # noqa: ANN401
        moved = self._new(
            "geometry_msgs/Transform",
            translation=self._vector("Vector3", pose.translation),
            rotation=self._quaternion(pose),
        )
        stamped = self._new(
            "geometry_msgs/TransformStamped", header=self.header(time_ns), child_frame_id=CAMERA, transform=moved
        )
        return self._new("tf2_msgs/TFMessage", transforms=[stamped])

    def path(self, times_ns: list[int], poses: tuple[Pose, ...]) -> Any:  # noqa: ANN401
        stamped = [
            self._new("geometry_msgs/PoseStamped", header=self.header(t), pose=self.pose(p))
            for t, p in zip(times_ns, poses, strict=True)
        ]
        return self._new("nav_msgs/Path", header=self.header(times_ns[-1]), poses=stamped)

    def markers(self, time_ns: int, things: tuple[MapObject, ...]) -> Any:  # noqa: ANN401
        return self._new("visualization_msgs/MarkerArray", markers=[self._marker(time_ns, t) for t in things])

    def _marker(self, time_ns: int, thing: MapObject) -> Any:  # noqa: ANN401
        corners = thing.faces.ravel().tolist()
        points = [self._vector("Point", point) for point in thing.vertices.tolist()]
        paints = [self._colour(*row) for row in (vertex_colours(thing) / 255.0).tolist()]
        nothing = self._new("builtin_interfaces/Duration", sec=0, nanosec=0)
        return self._new(
            "visualization_msgs/Marker",
            header=self.header(time_ns),
            ns=thing.category,
            id=thing.id,
            type=TRIANGLE_LIST,
            action=0,
            pose=self.pose(thing.world_from_object),
            scale=self._vector("Vector3", np.ones(3)),
            color=self._colour(1.0, 1.0, 1.0, 1.0),
            lifetime=nothing,
            frame_locked=False,
            points=[points[i] for i in corners],
            colors=[paints[i] for i in corners],
            texture_resource="",
            texture=self._new(
                "sensor_msgs/CompressedImage",
                header=self.header(time_ns, ""),
                format="",
                data=np.zeros(0, np.uint8),
            ),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=self._new("visualization_msgs/MeshFile", filename="", data=np.zeros(0, np.uint8)),
            mesh_use_embedded_materials=False,
        )

    def _colour(self, r: float, g: float, b: float, a: float) -> Any:  # noqa: ANN401
        return self._new("std_msgs/ColorRGBA", r=float(r), g=float(g), b=float(b), a=float(a))
