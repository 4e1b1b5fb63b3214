"""What bags have in common: messages on channels, each at a position where it can be read again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

from meshslam.sequences.report import Report

MISSING = 'bags need rosbags and mcap: pip install "meshslam[bags]"'
LARGEST_CHUNK = 2**30  # bytes, unpacked: writers make chunks of some megabytes


class Position(NamedTuple):
    """Where a message lies."""

    file: int  # of the store's files
    record: int  # byte of its record or chunk, or the row's id
    offset: int = -1  # byte within the unpacked chunk; -1: the record is the message itself


@dataclass(frozen=True)
class Channel:
    """A topic and how its messages are written."""

    topic: str
    type_name: str  # sensor_msgs/msg/Image, foxglove.RawImage
    encoding: str  # ros1, cdr, protobuf, json, or what is not read
    schema_encoding: str = ""  # ros1msg, ros2msg, ros2idl, protobuf, jsonschema; "" : none is there
    schema: bytes = b""


@dataclass(frozen=True)
class RawMessage:
    """A message as it is written."""

    channel: Channel
    log_ns: int
    position: Position
    data: bytes


class Store(Protocol):
    """A bag's files; copies hold no open handle."""

    @property
    def path(self) -> Path:
        """The file or folder that the user named."""

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that hold messages."""

    @property
    def size(self) -> int:
        """Of all files, in the unit of `read_until`."""

    def read_until(self, position: Position) -> int:
        """How much lies before a message, for progress."""

    def messages(self, report: Report) -> Iterator[RawMessage]:
        """All messages in the order of the files; a cut or damaged end is noted, and what is before it is given."""

    def read(self, position: Position) -> bytes:
        """The content of one message again; FoundError where the file has changed."""
