"""MCAP files, whoever wrote them: records with an opcode and a length, most of them in chunks (mcap.dev/spec)."""

from __future__ import annotations

import io
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from meshslam.sequences.bags.decoding import ros_type
from meshslam.sequences.bags.store import LARGEST_CHUNK, Channel, Position, RawMessage
from meshslam.sequences.bags.unpacking import unpacked
from meshslam.sequences.report import FoundError, Report, fail

MAGIC = b"\x89MCAP0\r\n"
_HEAD = 9  # bytes before a record's content
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END, _FOOTER = 3, 4, 5, 6, 15, 2


@dataclass
class _Told:
    """Schemas and channels so far, by number."""

    schemas: dict[int, Any] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)


@dataclass(eq=False)
class McapFiles:
    """One MCAP file, or those of a ROS 2 bag in their order."""

    path: Path
    files: tuple[Path, ...]
    packed: str = ""  # the compression of each message, beyond that of the chunks
    _last: tuple[tuple[int, int], bytes] = field(default=((-1, -1), b""), repr=False)  # the chunk that was read last

    @property
    def size(self) -> int:
        """Bytes."""
        return sum(file.stat().st_size for file in self.files)

    def read_until(self, position: Position) -> int:
        """Bytes before it."""
        return sum(file.stat().st_size for file in self.files[: position.file]) + position.record

    def messages(self, report: Report) -> Iterator[RawMessage]:
        """See Store."""
        for number, path in enumerate(self.files):
            yield from self._messages_of(number, path, report)

    def _messages_of(self, number: int, path: Path, report: Report) -> Iterator[RawMessage]:
        told, size = _Told(), path.stat().st_size
        with path.open("rb") as file:
            file.seek(len(MAGIC))
            while True:
                start = file.tell()
                kind, body = _record(file, size)
                if kind is None:
                    report.note(path, f"byte {start}", "the file is cut here: what lies before is read")
                    return
                if kind in (_DATA_END, _FOOTER):
                    return
                try:
                    yield from self._of_record(number, start, kind, body, told)
                except FoundError as error:
                    report.note(path, error.problem.where, f"{error.problem.what}: left out")

    def _of_record(self, number: int, start: int, kind: int, body: bytes, told: _Told) -> Iterator[RawMessage]:
        if kind != _CHUNK:
            yield from self._message(Position(number, start), kind, body, told)
            return
        content = _content(self.files[number], start, body)
        inside, offset = io.BytesIO(content), 0
        while True:
            found, record = _record(inside, len(content))
            if found is None and offset != len(content):
                raise fail(self.files[number], f"byte {start}", "the rest of a damaged chunk")
            if found is None:
                return
            yield from self._message(Position(number, start, offset), found, record, told)
            offset = inside.tell()

    def _message(self, position: Position, kind: int, body: bytes, told: _Told) -> Iterator[RawMessage]:
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel as ChannelRecord
        from mcap.records import Message, Schema

        path, where = self.files[position.file], f"byte {position.record}"
        try:
            stream = ReadDataStream(io.BytesIO(body))
            if kind == _SCHEMA:
                schema = Schema.read(stream)
                told.schemas[schema.id] = schema
            elif kind == _CHANNEL:
                record = ChannelRecord.read(stream)
                told.channels[record.id] = _channel(record, told.schemas.get(record.schema_id))
            elif kind == _MESSAGE:
                message = Message.read(stream, len(body))
                channel = told.channels.get(message.channel_id)
                if channel is not None:
                    yield RawMessage(channel, message.log_time, position, self._unpacked(path, where, message.data))
        except FoundError:
            raise
        except Exception as error:  # short records raise whatever the library comes upon
            raise fail(path, where, f"a record is damaged: {type(error).__name__}") from None

    def _unpacked(self, path: Path, where: str, data: bytes) -> bytes:
        return unpacked(path, where, self.packed, data)

    def read(self, position: Position) -> bytes:
        """See Store."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Message

        path, where = self.files[position.file], f"byte {position.record}"
        with path.open("rb") as file:
            if position.offset < 0:
                file.seek(position.record)
                kind, body = _record(file, path.stat().st_size)
            else:
                content = self._chunk(file, position)
                inside = io.BytesIO(content)
                inside.seek(position.offset)
                kind, body = _record(inside, len(content))
        if kind != _MESSAGE:
            raise fail(path, where, "the message is gone: has the file changed?")
        return self._unpacked(path, where, Message.read(ReadDataStream(io.BytesIO(body)), len(body)).data)

    def _chunk(self, file: BinaryIO, position: Position) -> bytes:
        last, key = self._last, (position.file, position.record)
        if last[0] == key:
            return last[1]
        path = self.files[position.file]
        file.seek(position.record)
        kind, body = _record(file, path.stat().st_size)
        if kind != _CHUNK:
            raise fail(path, f"byte {position.record}", "the chunk is gone: has the file changed?")
        content = _content(path, position.record, body)
        self._last = (key, content)
        return content


def _record(file: BinaryIO, size: int) -> tuple[int | None, bytes]:
    """Opcode and content of the next record; None where there is no whole one. Only what is used is read."""
    head = file.read(_HEAD)
    length = int.from_bytes(head[1:], "little")
    if len(head) < _HEAD or file.tell() + length > size or length > LARGEST_CHUNK:
        return None, b""
    if head[0] in (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK):
        return head[0], file.read(length)
    file.seek(length, io.SEEK_CUR)
    return head[0], b""


def _content(path: Path, start: int, body: bytes) -> bytes:
    """A chunk unpacked, its checksum held."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk

    where = f"byte {start}"
    try:
        chunk = Chunk.read(ReadDataStream(io.BytesIO(body)))
    except Exception as error:  # short records raise whatever the library comes upon
        raise fail(path, where, f"a chunk is damaged: {type(error).__name__}") from None
    content = unpacked(path, where, chunk.compression, chunk.data)
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        raise fail(path, where, "a chunk is damaged: its checksum is wrong")
    return content


def _channel(record: Any, schema: Any) -> Channel:  # noqa: ANN401 # the library's records
    name = "" if schema is None else schema.name
    return Channel(
        topic=record.topic,
        type_name=ros_type(name) if record.message_encoding in ("ros1", "cdr") else name,
        encoding=record.message_encoding,
        schema_encoding="" if schema is None else schema.encoding,
        schema=b"" if schema is None else bytes(schema.data),
    )
