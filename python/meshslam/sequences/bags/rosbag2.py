"""ROS 2 bags: a folder with metadata.yaml and SQLite or MCAP files, or such files of a recording that was cut off."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from meshslam.sequences.bags.decoding import ros_type
from meshslam.sequences.bags.kinds import KINDS
from meshslam.sequences.bags.mcap_files import McapFiles
from meshslam.sequences.bags.store import Channel, Position, RawMessage, Store
from meshslam.sequences.bags.unpacking import unpacked, unpacking_command
from meshslam.sequences.images import natural_key
from meshslam.sequences.report import Report, fail
from meshslam.sequences.text import read_yaml

INFORMATION = "rosbag2_bagfile_information"
SUFFIXES = (".db3", ".mcap")


def is_ros2_folder(path: Path) -> bool:
    """Whether a folder is a ROS 2 bag: by its metadata, or without any by the only kind of files in it."""
    metadata = path / "metadata.yaml"
    if metadata.is_file():
        with metadata.open("rb") as file:
            return INFORMATION.encode() in file.read(4096)
    return path.is_dir() and bool(_loose_files(path) or _packed_files(path))


def open_ros2_folder(path: Path, report: Report) -> Store:
    """The store of a folder's files; FoundError for missing files and storages that are not read."""
    if not (path / "metadata.yaml").is_file():
        files = _loose_files(path) or [_unpacked(file) for file in _packed_files(path)]
        _check_one_recording(path, files)
        report.note(path, "", "metadata.yaml is missing, as where a recording is cut off: all of its files are read")
        return open_ros2_files(path, files, "")
    file = path / "metadata.yaml"
    told = read_yaml(file).get(INFORMATION)
    names = told.get("relative_file_paths") if isinstance(told, dict) else None
    if not isinstance(told, dict) or not isinstance(names, list) or not names:
        raise fail(file, INFORMATION, "expected relative_file_paths, a list of the bag's files")
    mode = str(told.get("compression_mode") or "none").lower()
    files = [path / PurePath(str(name)).name for name in names]
    if mode == "file":
        files = [_unpacked(file) for file in files]
    return open_ros2_files(path, files, str(told.get("compression_format") or "") if mode == "message" else "")


def open_ros2_files(path: Path, files: list[Path], packed: str) -> Store:
    """The store of files of one kind; `packed` is how each message is compressed."""
    for file in files:
        if not file.is_file():
            raise fail(file, "", "no such file, but metadata.yaml names it")
    kinds = {file.suffix for file in files}
    if kinds == {".mcap"}:
        return McapFiles(path, tuple(files), packed)
    if kinds == {".db3"}:
        return SqliteBag(path, tuple(files), packed)
    raise fail(path, "", f"files of {', '.join(sorted(kinds)) or 'no kind'}: only .db3 (SQLite) or .mcap are read")


def _check_one_recording(path: Path, files: list[Path]) -> None:
    """FoundError for several files that are not named as parts of one recording: NAME_0, NAME_1 and so on."""
    names = {re.sub(r"_\d+$", "", file.stem) for file in files}
    if len(names) > 1:
        listed = ", ".join(file.name for file in files[:4]) + (", …" if len(files) > 4 else "")
        raise fail(path, "", f"holds {len(names)} recordings ({listed}): name one of the files")


def _unpacked(file: Path) -> Path:
    """What a file that rosbag2 compressed as a whole becomes; FoundError where it is not there, with the command."""
    command = unpacking_command(file, SUFFIXES)
    plain = file.with_suffix("") if command else file
    if not plain.is_file() and file.is_file():
        raise fail(file, "", f"the file is compressed as a whole: unpack each such file in its folder: {command}")
    return plain


def _loose_files(path: Path) -> list[Path]:
    files = sorted((p for p in path.iterdir() if p.suffix in SUFFIXES and p.is_file()), key=natural_key)
    return files if len({p.suffix for p in files}) == 1 else []


def _packed_files(path: Path) -> list[Path]:
    return sorted((p for p in path.iterdir() if unpacking_command(p, SUFFIXES)), key=natural_key)


@dataclass(eq=False)
class SqliteBag:
    """Messages are rows of the table `messages`."""

    path: Path
    files: tuple[Path, ...]
    packed: str = ""

    @property
    def size(self) -> int:
        """Rows, as far as they are counted without a pass over them: messages are numbered one by one."""
        return sum(_last_row(file) for file in self.files)

    def read_until(self, position: Position) -> int:
        """Rows before it."""
        return sum(_last_row(file) for file in self.files[: position.file]) + position.record

    def messages(self, report: Report) -> Iterator[RawMessage]:
        """See Store."""
        for number, file in enumerate(self.files):
            yield from self._messages_of(number, file, report)

    def _messages_of(self, number: int, file: Path, report: Report) -> Iterator[RawMessage]:
        count = 0
        try:
            with _connection(file) as connection:
                channels = _channels(connection)
                wanted = [key for key, channel in channels.items() if channel.type_name in KINDS]
                marks = ",".join("?" * len(wanted))
                content = f"CASE WHEN topic_id IN ({marks}) THEN data ELSE x'' END"
                query = f"SELECT id, topic_id, timestamp, {content} FROM messages ORDER BY id"
                for row, topic, log_ns, data in connection.execute(query, wanted):
                    if topic in channels:
                        yield self._message(file, Position(number, row), channels[topic], log_ns, data)
                        count += 1
        except sqlite3.Error as error:
            report.note(file, f"message {count}", f"the database is cut or damaged ({error}): what lies before is read")

    def _message(self, file: Path, position: Position, channel: Channel, log_ns: int, data: bytes) -> RawMessage:
        content = unpacked(file, f"row {position.record}", self.packed, data) if data else b""
        return RawMessage(channel, log_ns, position, content)

    def read(self, position: Position) -> bytes:
        """See Store."""
        file, where = self.files[position.file], f"row {position.record}"
        try:
            with _connection(file) as connection:
                found = connection.execute("SELECT data FROM messages WHERE id = ?", (position.record,)).fetchone()
        except sqlite3.Error as error:
            raise fail(file, where, f"cannot be read: {error}") from None
        if found is None:
            raise fail(file, where, "the message is gone: has the bag changed?")
        return unpacked(file, where, self.packed, bytes(found[0]))


def _last_row(file: Path) -> int:
    try:
        with _connection(file) as connection:
            return int(connection.execute("SELECT max(id) FROM messages").fetchone()[0] or 0)
    except (sqlite3.Error, TypeError):
        return 0


class _connection:  # noqa: N801 # used as a function
    """A database that is only read, closed behind `with`."""

    def __init__(self, file: Path) -> None:
        self._opened = sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
        self._opened.execute("PRAGMA writable_schema = ON")  # else files that are cut are refused as a whole

    def __enter__(self) -> sqlite3.Connection:
        return self._opened

    def __exit__(self, *_: object) -> None:
        self._opened.close()


def _channels(connection: sqlite3.Connection) -> dict[int, Channel]:
    definitions = _definitions(connection)
    rows = connection.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
    return {key: _channel(name, kind, form, definitions.get(kind, ("", ""))) for key, name, kind, form in rows}


def _channel(topic: str, kind: str, form: str, definition: tuple[str, str]) -> Channel:
    return Channel(topic, ros_type(kind), form, definition[0], definition[1].encode())


def _definitions(connection: sqlite3.Connection) -> dict[str, tuple[str, str]]:
    """Encoding and text by type, which bags hold since ROS 2 Iron."""
    found: list[Any] = []
    if connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'").fetchone():
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        found = connection.execute(query).fetchall()
    return {kind: (encoding, text) for kind, encoding, text in found}
