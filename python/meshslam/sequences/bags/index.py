"""What a bag holds, from one pass over it: images by position, everything small by content."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.geometry import Floats
from meshslam.sequences.bags.decoding import decoded, frame_of, stamp_ns
from meshslam.sequences.bags.kinds import KINDS, Kind
from meshslam.sequences.bags.pixels import bytes_of, form_of
from meshslam.sequences.bags.store import Channel, Position, RawMessage, Store
from meshslam.sequences.bags.video_images import is_key
from meshslam.sequences.report import FoundError, Report, fail, late

_COUNTED = 50  # messages between two words of progress
_PERCENT = 100


@dataclass
class Topic:
    """The messages of one topic, as far as they are of use."""

    channel: Channel
    kind: Kind | None
    count: int = 0
    unreadable: int = 0
    why: str = ""  # the first of them cannot be read
    frame: str = ""  # that headers name
    child_frame: str = ""
    header_ns: array[int] = field(default_factory=lambda: array("q"))  # when messages were taken
    log_ns: array[int] = field(default_factory=lambda: array("q"))  # when they were written
    positions: list[Position] = field(default_factory=list)  # of images
    form: str = ""  # encoding or format of the first image
    keys: list[bool] = field(default_factory=list)  # of video: which messages begin anew
    values: array[float] = field(default_factory=lambda: array("d"))  # wx wy wz ax ay az, or x y z qx qy qz qw
    camera: Any = None  # the first calibration
    camera_data: bytes = b""  # the message that it came in
    changes: int = 0  # of the calibration

    @property
    def name(self) -> str:
        """As `--topic` takes it."""
        return self.channel.topic

    @property
    def is_video(self) -> bool:
        """Whether its images need those before them."""
        return self.channel.type_name.endswith("CompressedVideo")

    @property
    def rows(self) -> Floats:
        """One a message: IMU samples (n, 6), poses (n, 7)."""
        return np.frombuffer(self.values, float).reshape(-1, 6 if self.kind == "imu" else 7)

    def stamp(self, message: Any, raw: RawMessage) -> None:  # noqa: ANN401 # by the schema
        """Take a message's times and frame."""
        self.header_ns.append(stamp_ns(message))
        self.log_ns.append(raw.log_ns)
        self.frame = self.frame or frame_of(message)


@dataclass
class Edge:
    """parent_from_child over time."""

    is_static: bool
    times_ns: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))

    @property
    def rows(self) -> Floats:
        """Numbers x y z qx qy qz qw (n, 7)."""
        return np.frombuffer(self.values, float).reshape(-1, 7)


@dataclass
class BagIndex:
    """All topics by name, and the transforms by (parent, child)."""

    path: Path
    topics: dict[str, Topic] = field(default_factory=dict)
    edges: dict[tuple[str, str], Edge] = field(default_factory=dict)
    transform_topics: set[str] = field(default_factory=set)

    @property
    def count(self) -> int:
        """Of all messages."""
        return sum(topic.count for topic in self.topics.values())

    def of(self, kind: Kind) -> list[Topic]:
        """The topics of a kind that hold messages which can be read, by name."""
        found = [t for t in self.topics.values() if t.kind == kind and t.count > t.unreadable]
        return sorted(found, key=lambda topic: topic.name)


def build_index(store: Store, report: Report) -> BagIndex:
    """Read a bag once; FoundError where it holds no message, notes for what cannot be read."""
    index, told = BagIndex(store.path), len(report.notes)
    size, progress = max(store.size, 1), late(report.progress)
    for raw in store.messages(report):
        if not index.count % _COUNTED:
            progress("bag's index", round(_PERCENT * store.read_until(raw.position) / size), _PERCENT)
        topic = index.topics.get(raw.channel.topic)
        if topic is None or topic.channel.type_name != raw.channel.type_name:
            topic = _new_topic(index, raw.channel)
        topic.count += 1
        if topic.kind is not None:
            _take(index, topic, raw)
    if not index.count:
        cut = "; the file is cut or damaged" if len(report.notes) > told else ""
        raise fail(store.path, "", f"the bag holds no messages{cut}")
    if len(report.notes) > told:
        report.note(store.path, "", f"{index.count} messages could be read of a bag that is cut or damaged")
    for topic in index.topics.values():
        if topic.unreadable:
            report.note(store.path, topic.name, f"{topic.unreadable} of {topic.count} messages left out: {topic.why}")
    return index


def _new_topic(index: BagIndex, channel: Channel) -> Topic:
    name = channel.topic if channel.topic not in index.topics else f"{channel.topic} ({channel.type_name})"
    return index.topics.setdefault(name, Topic(channel, KINDS.get(channel.type_name)))


def _take(index: BagIndex, topic: Topic, raw: RawMessage) -> None:
    try:
        message = decoded(index.path, raw.channel, raw.data)
        taken = _TAKERS[topic.kind or "image"](index, topic, message, raw)
    except FoundError as error:
        _miss(topic, error.problem.what)
    except (AttributeError, TypeError, ValueError, StopIteration, OverflowError) as error:
        _miss(topic, f"a field is missing or no number: {str(error)[:80]}")
    else:
        if not taken:
            _miss(topic, "values that are not finite, or no rotation")


def _miss(topic: Topic, why: str) -> None:
    topic.unreadable += 1
    topic.why = topic.why or why


def _image(index: BagIndex, topic: Topic, message: Any, raw: RawMessage) -> bool:  # noqa: ANN401 # by the schema
    topic.stamp(message, raw)
    topic.positions.append(raw.position)
    topic.form = topic.form or form_of(message)
    if topic.is_video:
        topic.keys.append(is_key(topic.form, bytes_of(message.data)))
    return True


def _imu(index: BagIndex, topic: Topic, message: Any, raw: RawMessage) -> bool:  # noqa: ANN401 # by the schema
    row = (*_xyz(message.angular_velocity), *_xyz(message.linear_acceleration))
    if not np.isfinite(row).all():
        return False
    topic.stamp(message, raw)
    topic.values.extend(row)
    return True


def _camera(index: BagIndex, topic: Topic, message: Any, raw: RawMessage) -> bool:  # noqa: ANN401 # by the schema
    topic.frame = topic.frame or frame_of(message)
    if topic.camera is None:
        topic.camera, topic.camera_data = message, raw.data
    else:
        topic.changes += any(_differs(topic.camera, message, name) for name in ("width", "height", "k", "d", "p"))
    return True


def _differs(first: Any, other: Any, name: str) -> bool:  # noqa: ANN401 # by the schema
    return not np.array_equal(field_of(first, name), field_of(other, name))


def field_of(info: Any, name: str) -> Floats:  # noqa: ANN401 # by the schema
    """A calibration's field, which ROS 1 and Foxglove write large and ROS 2 small; numbers."""
    value = getattr(info, name, None)
    return np.asarray(getattr(info, name.upper(), ()) if value is None else value, float).reshape(-1)


def _poses(index: BagIndex, topic: Topic, message: Any, raw: RawMessage) -> bool:  # noqa: ANN401 # by the schema
    if hasattr(message, "transform"):
        row = _row(message.transform.translation, message.transform.rotation)
    else:
        pose = message.pose if hasattr(message.pose, "position") else message.pose.pose
        row = _row(pose.position, pose.orientation)
    if row is None:
        return False
    topic.stamp(message, raw)
    topic.values.extend(row)
    topic.child_frame = topic.child_frame or str(getattr(message, "child_frame_id", "")).lstrip("/")
    return True


def _transforms(index: BagIndex, topic: Topic, message: Any, raw: RawMessage) -> bool:  # noqa: ANN401 # by the schema
    several = getattr(message, "transforms", None)
    is_static = topic.name.rstrip("/").endswith("tf_static")
    index.transform_topics.add(topic.name)
    taken = True
    for one in [message] if several is None else several:
        inside = getattr(one, "transform", one)
        row = _row(inside.translation, inside.rotation)
        parent = str(getattr(one, "parent_frame_id", "")).lstrip("/") or frame_of(one)
        child = str(one.child_frame_id).lstrip("/")
        if row is None:
            taken = False
            continue
        edge = index.edges.setdefault((parent, child), Edge(is_static))
        time_ns = stamp_ns(one) or raw.log_ns
        if not (edge.is_static and edge.values):
            edge.times_ns.append(time_ns)
            edge.values.extend(row)
    return taken


_TAKERS: dict[Kind, Callable[[BagIndex, Topic, Any, RawMessage], bool]] = {
    "image": _image,
    "imu": _imu,
    "camera": _camera,
    "poses": _poses,
    "transforms": _transforms,
}


def _xyz(vector: Any) -> tuple[float, float, float]:  # noqa: ANN401 # by the schema
    return float(vector.x), float(vector.y), float(vector.z)


def _row(translation: Any, rotation: Any) -> tuple[float, ...] | None:  # noqa: ANN401 # by the schema
    """Numbers x y z qx qy qz qw, the quaternion of length 1; None for what is no pose."""
    quaternion = np.array([*_xyz(rotation), float(rotation.w)])
    length, place = float(np.linalg.norm(quaternion)), _xyz(translation)
    if not np.isfinite([length, *place]).all() or abs(length - 1) > 0.01:
        return None
    return (*place, *(quaternion / length).tolist())
