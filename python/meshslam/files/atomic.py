"""Files that are whole or not there: whatever kills the process, no half-written file has a final name."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from meshslam.errors import MapError, MeshslamError
from meshslam.files.lock import started

LEFTOVER_SUFFIX = ".meshslam-part"
Content = bytes | Callable[[], bytes]


def write_atomically(path: Path, content: bytes, error: type[MeshslamError] = MapError) -> None:
    """Write a file under its final name only when all of it is on the disk; `error` names it if that fails."""
    write_together({path: content}, path, error)


def write_into(path: Path, content: str | bytes, error: type[MeshslamError] = MapError) -> None:
    """Write a file of a folder that gets its name when it is whole; `error` names the file that cannot be written."""
    try:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    except OSError as problem:
        raise _named(problem, path, error) from None


def write_together(files: Mapping[Path, Content], last: Path, error: type[MeshslamError] = MapError) -> None:
    """Write several files; `last`, one of them, tells that the others are there.

    A content may be what makes it: it is made when it is written, so that only one of many is in memory.

    All contents are on the disk before the first name changes, and an older `last` goes first if others are replaced: a
    crash leaves the old set, or the new one, or a set without `last`. `error` names the file that the disk does not
    take.
    """
    parts = {path: part_of(path) for path in files}
    try:
        for path, content in files.items():
            _write_part(path, parts[path], content)
        if any(path.exists() for path in files if path != last):
            last.unlink(missing_ok=True)
        for path in sorted(files, key=lambda p: p == last):
            parts[path].replace(path)
        for folder in {path.parent for path in files}:
            sync_folder(folder)
    except OSError as problem:
        raise _named(problem, last, error) from None
    finally:
        for part in parts.values():
            _drop(part)


@contextlib.contextmanager
def written_aside(path: Path, error: type[MeshslamError] = MapError) -> Iterator[Path]:
    """A name beside `path` for the block to write; it becomes `path` once it is on the disk, or goes."""
    part = part_of(path)
    try:
        yield part
        sync_file(part)
        part.replace(path)
        sync_folder(path.parent)
    except OSError as problem:
        raise _named(problem, path, error) from None
    finally:
        _drop(part)


def remove_leftovers(folder: Path) -> None:
    """Remove what writers that were killed have left in a folder and below."""
    for part in folder.rglob(f".*{LEFTOVER_SUFFIX}"):
        _drop(part)


def remove_leftovers_of(path: Path) -> None:
    """Remove what writers of one file that were killed have left beside it; those that live go on."""
    begin = f".{path.name}."
    for part in path.parent.glob(f".*{LEFTOVER_SUFFIX}"):
        number = part.name.removeprefix(begin).removesuffix(LEFTOVER_SUFFIX)
        if part.name.startswith(begin) and number.isdecimal() and started(int(number)) is None:
            _drop(part)


def part_of(path: Path) -> Path:
    """A name beside the final one: a rename within one folder is atomic."""
    return path.with_name(f".{path.name}.{os.getpid()}{LEFTOVER_SUFFIX}")


def sync_file(path: Path) -> None:
    """Wait until a file's content is on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def sync_folder(folder: Path) -> None:
    """Make the new names last through a power cut, where the file system can."""
    with contextlib.suppress(OSError):
        sync_file(folder)


def _write_part(path: Path, part: Path, content: Content) -> None:
    """Write all of it to the disk; an OSError names the final path."""
    made = content if isinstance(content, bytes) else content()
    try:
        with part.open("wb") as file:
            file.write(made)
            file.flush()
            os.fsync(file.fileno())
    except OSError as problem:
        raise OSError(problem.errno, problem.strerror, str(path)) from None


def _named(problem: OSError, path: Path, error: type[MeshslamError]) -> MeshslamError:
    """The error that names the final path."""
    name = problem.filename or path
    shown = path if str(name).endswith(LEFTOVER_SUFFIX) else name
    return error(f"{shown}: cannot be written: {problem.strerror or problem}")


def _drop(part: Path) -> None:
    with contextlib.suppress(OSError):
        part.unlink(missing_ok=True)
