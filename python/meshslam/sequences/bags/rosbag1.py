"""ROS 1 bags, format 2.0: records of a header and data, most of them in chunks (wiki.ros.org/Bags/Format/2.0)."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from meshslam.sequences.bags.decoding import ros_type
from meshslam.sequences.bags.store import Channel, Position, RawMessage
from meshslam.sequences.bags.unpacking import unpacked
from meshslam.sequences.report import FoundError, Report, fail

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG, _CHUNK, _CONNECTION = 2, 3, 5, 7
_LARGEST_HEADER = 2**20  # bytes


@dataclass(eq=False)
class Ros1Bag:
    """A .bag file, read from front to back, its index or not."""

    path: Path
    _last: tuple[int, bytes] = field(default=(-1, b""), repr=False)  # the chunk that was read last

    @property
    def files(self) -> tuple[Path, ...]:
        """See Store."""
        return (self.path,)

    @property
    def size(self) -> int:
        """Bytes."""
        return self.path.stat().st_size

    def read_until(self, position: Position) -> int:
        """Bytes before it."""
        return position.record

    def messages(self, report: Report) -> Iterator[RawMessage]:
        """See Store."""
        channels: dict[int, Channel] = {}
        with self.path.open("rb") as file:
            file.seek(len(MAGIC))
            while True:
                start = file.tell()
                record = _record(file)
                if record is None:
                    break
                header, data = record
                try:
                    yield from self._of_record(start, header, data, channels)
                except FoundError as error:
                    report.note(self.path, error.problem.where, f"{error.problem.what}: left out")
            if start != self.path.stat().st_size:
                report.note(self.path, f"byte {start}", "the bag is cut here: what lies before is read")

    def _of_record(
        self, start: int, header: dict[str, bytes], data: bytes, channels: dict[int, Channel]
    ) -> Iterator[RawMessage]:
        kind = _number(header, "op")
        if kind == _CHUNK:
            content = self._content(start, header, data)
            chunk, offset = io.BytesIO(content), 0
            while (record := _record(chunk)) is not None:
                yield from self._message(Position(0, start, offset), *record, channels)
                offset = chunk.tell()
            if offset != len(content):
                raise fail(self.path, f"byte {start}", "the rest of a damaged chunk")
        else:  # an interrupted chunk's messages lie bare
            yield from self._message(Position(0, start), header, data, channels)

    def _message(
        self, position: Position, header: dict[str, bytes], data: bytes, channels: dict[int, Channel]
    ) -> Iterator[RawMessage]:
        kind, number = _number(header, "op"), _number(header, "conn")
        if kind == _CONNECTION:
            channels[number] = _channel(header, data)
        elif kind == _MESSAGE and number in channels:
            time = header.get("time", bytes(8))
            log_ns = int.from_bytes(time[:4], "little") * 10**9 + int.from_bytes(time[4:], "little")
            yield RawMessage(channels[number], log_ns, position, data)

    def read(self, position: Position) -> bytes:
        """See Store."""
        with self.path.open("rb") as file:
            if position.offset < 0:
                file.seek(position.record)
                record = _record(file)
            else:
                chunk = io.BytesIO(self._chunk(file, position.record))
                chunk.seek(position.offset)
                record = _record(chunk)
        if record is None:
            raise fail(self.path, f"byte {position.record}", "the message is gone: has the bag changed?")
        return record[1]

    def _chunk(self, file: BinaryIO, start: int) -> bytes:
        last = self._last
        if last[0] == start:
            return last[1]
        file.seek(start)
        record = _record(file)
        if record is None:
            raise fail(self.path, f"byte {start}", "the chunk is gone: has the bag changed?")
        content = self._content(start, *record)
        self._last = (start, content)
        return content

    def _content(self, start: int, header: dict[str, bytes], data: bytes) -> bytes:
        kind = header.get("compression", b"").decode("ascii", "replace")
        return unpacked(self.path, f"byte {start}", kind, data)


def _record(file: BinaryIO) -> tuple[dict[str, bytes], bytes] | None:
    """The fields and data of the next record; None where there is no whole one."""
    length = _length(file)
    if length is None or length > _LARGEST_HEADER:
        return None
    packed = file.read(length)
    size = _length(file)
    if len(packed) != length or size is None or size > _left(file):
        return None
    return _fields(packed), file.read(size)


def _left(file: BinaryIO) -> int:
    here = file.tell()
    end = file.seek(0, io.SEEK_END)
    file.seek(here)
    return end - here


def _length(file: BinaryIO) -> int | None:
    found = file.read(4)
    return int.from_bytes(found, "little") if len(found) == 4 else None


def _fields(packed: bytes) -> dict[str, bytes]:
    found, at = {}, 0
    while at + 4 <= len(packed):
        end = at + 4 + int.from_bytes(packed[at : at + 4], "little")
        name, _, value = packed[at + 4 : end].partition(b"=")
        found[name.decode("ascii", "replace")] = value
        at = end
    return found


def _number(header: dict[str, bytes], name: str) -> int:
    return int.from_bytes(header.get(name, b"\xff"), "little")


def _channel(header: dict[str, bytes], data: bytes) -> Channel:
    told = _fields(data)
    return Channel(
        topic=header.get("topic", b"").decode("utf-8", "replace"),
        type_name=ros_type(told.get("type", b"").decode("utf-8", "replace")),
        encoding="ros1",
        schema_encoding="ros1msg",
        schema=told.get("message_definition", b""),
    )
