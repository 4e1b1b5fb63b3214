"""Messages as objects with named fields, by rosbags, Protocol Buffers or JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from meshslam.sequences.bags.store import Channel
from meshslam.sequences.report import fail

Decoder = Callable[[bytes], Any]
_ROS_TYPE = re.compile(r"\w+(/\w+)+", re.ASCII)
_IDL_RULE = "=" * 80 + "\n"


def decoded(path: Path, channel: Channel, data: bytes) -> Any:  # noqa: ANN401 # whatever the schema says
    """A message's fields; FoundError where its schema or its content cannot be read."""
    try:
        return _decoder(channel)(data)
    except Exception as error:  # damaged content raises whatever the libraries come upon
        said = f"{type(error).__name__}: {' '.join(str(error).split())[:100]}"
        raise fail(path, channel.topic, f"{channel.type_name:.60} cannot be decoded: {said}") from None


def ros_type(name: str) -> str:
    """sensor_msgs/msg/Image from sensor_msgs/Image too.

    >>> ros_type("sensor_msgs/Image"), ros_type("foxglove.RawImage")
    ('sensor_msgs/msg/Image', 'foxglove.RawImage')
    """
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


@lru_cache(maxsize=256)
def _decoder(channel: Channel) -> Decoder:
    if channel.encoding in ("ros1", "cdr"):
        return _ros_decoder(channel)
    if channel.encoding == "protobuf":
        return _protobuf_decoder(channel)
    if channel.encoding == "json":
        return lambda data: json.loads(data, object_hook=lambda fields: SimpleNamespace(**fields))
    raise ValueError(f"encoding {channel.encoding!r:.40} is not read")


def _ros_decoder(channel: Channel) -> Decoder:
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if not _ROS_TYPE.fullmatch(channel.type_name):
        raise ValueError("its name is none of a ROS type")
    text = channel.schema.decode()
    if channel.schema_encoding == "ros2idl":
        types = get_typestore(Stores.EMPTY)
        for part in text.split(_IDL_RULE)[1:] if text.startswith(_IDL_RULE) else [text]:
            types.register(get_types_from_idl(part.partition("\n")[2] if part.startswith("IDL: ") else part))
    elif text.strip():
        types = get_typestore(Stores.EMPTY)
        types.register(get_types_from_msg(text, channel.type_name))
    else:
        types = get_typestore(Stores.ROS2_HUMBLE)
    read = types.deserialize_ros1 if channel.encoding == "ros1" else types.deserialize_cdr
    return lambda data: read(data, channel.type_name)


def _protobuf_decoder(channel: Channel) -> Decoder:
    from mcap.records import Schema
    from mcap_protobuf.decoder import DecoderFactory

    schema = Schema(id=1, name=channel.type_name, encoding="protobuf", data=channel.schema)
    read: Decoder | None = DecoderFactory().decoder_for("protobuf", schema)
    if read is None:
        raise ValueError("the schema is no Protocol Buffers schema")
    return read


def stamp_ns(message: Any) -> int:  # noqa: ANN401 # whatever the schema says
    """Nanoseconds of a message's header stamp, or its own stamp or time."""
    header = getattr(message, "header", None)
    time = message.timestamp if header is None else header.stamp
    seconds = next(getattr(time, name) for name in ("sec", "seconds", "secs") if hasattr(time, name))
    rest = next((getattr(time, name) for name in ("nanosec", "nsec", "nanos", "nsecs") if hasattr(time, name)), 0)
    return int(seconds) * 10**9 + int(rest)


def frame_of(message: Any) -> str:  # noqa: ANN401 # whatever the schema says
    """The coordinate frame that a message's header names, without a slash before it."""
    header = getattr(message, "header", None)
    return str(getattr(message if header is None else header, "frame_id", "")).lstrip("/")
