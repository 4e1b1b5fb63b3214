"""Messages out. Every number is a float of Python: ROS' messages check nothing, and send what is none as garbage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from meshslam.geometry import Floats, Pose, quaternions_of_rotations
from meshslam.maps import MapObject, object_colour
from meshslam.ros2.conventions import UNKNOWN_VARIANCE, pose_covariance_in_parent

SURE_COLOUR, UNSURE_COLOUR = (0.10, 0.62, 0.30), (0.85, 0.20, 0.15)  # of vertices, red, green, blue from 0 to 1
SURE_SIGMA_M, UNSURE_SIGMA_M = 0.03, 0.15
LEVELS = (b"\x00", b"\x01", b"\x02", b"\x03")  # DiagnosticStatus: OK, WARN, ERROR, STALE


def stamp_of(nanoseconds: int) -> Any:  # noqa: ANN401 # builtin_interfaces/Time
    """A time of a message."""
    from builtin_interfaces.msg import Time

    seconds, rest = divmod(int(nanoseconds), 10**9)
    return Time(sec=seconds, nanosec=rest)


def header(frame_id: str, nanoseconds: int) -> Any:  # noqa: ANN401 # std_msgs/Header
    """A header with a stamp."""
    from std_msgs.msg import Header

    return Header(stamp=stamp_of(nanoseconds), frame_id=frame_id)


def pose_message(pose: Pose) -> Any:  # noqa: ANN401 # geometry_msgs/Pose
    """A pose; its quaternion has w >= 0."""
    from geometry_msgs.msg import Point, Quaternion
    from geometry_msgs.msg import Pose as PoseMessage

    x, y, z = (float(v) for v in pose.translation)
    qx, qy, qz, qw = (float(v) for v in quaternions_of_rotations(pose.rotation[None])[0])
    return PoseMessage(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def odometry_message(
    parent: str,
    child: str,
    nanoseconds: int,
    world_from_child: Pose,
    covariance: Floats | None,
    twist: tuple[Floats, Floats] | None,
) -> Any:  # noqa: ANN401 # nav_msgs/Odometry
    """nav_msgs/Odometry; `covariance` (6, 6) is of a right perturbation of world_from_child, `twist` in the child.

    What is not known has the variance 1e6.
    """
    from nav_msgs.msg import Odometry

    unknown = np.eye(6) * UNKNOWN_VARIANCE
    message = Odometry(header=header(parent, nanoseconds), child_frame_id=child)
    message.pose.pose = pose_message(world_from_child)
    known = unknown if covariance is None else pose_covariance_in_parent(world_from_child, covariance)
    message.pose.covariance = [float(v) for v in known.ravel()]
    message.twist.covariance = [float(v) for v in unknown.ravel()]
    if twist is not None:
        for vector, values in zip((message.twist.twist.linear, message.twist.twist.angular), twist, strict=True):
            vector.x, vector.y, vector.z = (float(v) for v in values)
    return message


def sure_pose_message(frame_id: str, nanoseconds: int, world_from_child: Pose, covariance: Floats | None) -> Any:  # noqa: ANN401 # geometry_msgs/PoseWithCovarianceStamped
    """A pose with its covariance (6, 6), that of a right perturbation; what is not known has the variance 1e6."""
    from geometry_msgs.msg import PoseWithCovarianceStamped

    message = PoseWithCovarianceStamped(header=header(frame_id, nanoseconds))
    message.pose.pose = pose_message(world_from_child)
    known = np.eye(6) * UNKNOWN_VARIANCE
    if covariance is not None:
        known = pose_covariance_in_parent(world_from_child, covariance)
    message.pose.covariance = [float(v) for v in known.ravel()]
    return message


def stamped_pose(frame_id: str, nanoseconds: int, pose: Pose) -> Any:  # noqa: ANN401 # geometry_msgs/PoseStamped
    """One pose of a path."""
    from geometry_msgs.msg import PoseStamped

    return PoseStamped(header=header(frame_id, nanoseconds), pose=pose_message(pose))


def path_message(frame_id: str, nanoseconds: int, poses: Sequence[Any]) -> Any:  # noqa: ANN401 # nav_msgs/Path
    """nav_msgs/Path of stamped poses."""
    from nav_msgs.msg import Path

    return Path(header=header(frame_id, nanoseconds), poses=list(poses))


def transform_message(parent: str, child: str, nanoseconds: int, parent_from_child: Pose) -> Any:  # noqa: ANN401 # ROS'
    """geometry_msgs/TransformStamped."""
    from geometry_msgs.msg import TransformStamped, Vector3

    message = TransformStamped(header=header(parent, nanoseconds), child_frame_id=child)
    x, y, z = (float(v) for v in parent_from_child.translation)
    message.transform.translation = Vector3(x=x, y=y, z=z)
    message.transform.rotation = pose_message(parent_from_child).orientation
    return message


def object_marker(frame_id: str, nanoseconds: int, thing: MapObject) -> Any:  # noqa: ANN401 # visualization_msgs/Marker
    """An object's own mesh as triangles in its frame; namespace and id are its category and id.

    Where sigmas are known, vertices are green up to 0.03 m and red from 0.15 m on; else all have the object's colour.
    """
    from geometry_msgs.msg import Point, Vector3
    from std_msgs.msg import ColorRGBA
    from visualization_msgs.msg import Marker

    colours = vertex_colours(thing)
    corners = thing.faces.ravel().tolist()
    points = [Point(x=x, y=y, z=z) for x, y, z in np.asarray(thing.vertices, float).tolist()]
    paints = [ColorRGBA(r=r, g=g, b=b, a=1.0) for r, g, b in colours.tolist()]
    return Marker(
        header=header(frame_id, nanoseconds),
        ns=str(thing.category),
        id=int(thing.id),
        type=Marker.TRIANGLE_LIST,
        action=Marker.ADD,
        pose=pose_message(thing.world_from_object),
        scale=Vector3(x=1.0, y=1.0, z=1.0),
        color=ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0),
        points=[points[i] for i in corners],
        colors=[paints[i] for i in corners],
    )


def vertex_colours(thing: MapObject) -> Floats:
    """Colours (V, 3) of an object's vertices, 0 to 1, by their sigmas."""
    if thing.vertex_sigma_m is None:
        one: Floats = np.tile(object_colour(thing.id) / 255.0, (len(thing.vertices), 1))
        return one
    span = np.log(UNSURE_SIGMA_M / SURE_SIGMA_M)
    share = np.clip(np.log(np.maximum(thing.vertex_sigma_m, 1e-9) / SURE_SIGMA_M) / span, 0.0, 1.0)[:, None]
    colours: Floats = (1 - share) * np.array(SURE_COLOUR) + share * np.array(UNSURE_COLOUR)
    return colours


def deleted_marker(frame_id: str, nanoseconds: int, category: str, number: int) -> Any:  # noqa: ANN401 # Marker
    """An object that is no longer in the map."""
    from visualization_msgs.msg import Marker

    return Marker(header=header(frame_id, nanoseconds), ns=category, id=int(number), action=Marker.DELETE)


def all_deleted_marker(frame_id: str, nanoseconds: int) -> Any:  # noqa: ANN401 # visualization_msgs/Marker
    """Everything that was shown goes."""
    from visualization_msgs.msg import Marker

    return Marker(header=header(frame_id, nanoseconds), action=Marker.DELETEALL)


def marker_array(markers: Sequence[Any]) -> Any:  # noqa: ANN401 # visualization_msgs/MarkerArray
    """Markers in one message."""
    from visualization_msgs.msg import MarkerArray

    return MarkerArray(markers=list(markers))


def diagnostic_array(nanoseconds: int, statuses: Sequence[tuple[str, int, str, Mapping[str, object]]]) -> Any:  # noqa: ANN401 # ROS'
    """diagnostic_msgs/DiagnosticArray of names, levels (0 OK, 1 WARN, 2 ERROR), messages and values."""
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    return DiagnosticArray(
        header=header("", nanoseconds),
        status=[
            DiagnosticStatus(
                level=LEVELS[level],
                name=name,
                message=message,
                hardware_id="meshslam",
                values=[KeyValue(key=str(key), value=str(value)) for key, value in values.items()],
            )
            for name, level, message, values in statuses
        ],
    )
