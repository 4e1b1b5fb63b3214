"""Files that are whole or not there: whatever kills the process, no half-written file has a final name."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path

from meshslam.errors import MapError

LEFTOVER_SUFFIX = ".meshslam-part"


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file under its final name only when all of it is on the disk; MapError if it cannot be written."""
    write_together({path: content}, path)


def write_together(files: Mapping[Path, bytes], last: Path) -> None:
    """Write several files; `last`, one of them, tells that the others are there.

    All contents are on the disk before the first name changes, and an older `last` goes first: a crash leaves the old
    set, or the new one, or a set without `last`.
    """
    parts: dict[Path, Path] = {}
    try:
        for path, content in files.items():
            parts[path] = _write_part(path, content)
        if len(files) > 1:
            last.unlink(missing_ok=True)
        for path in sorted(files, key=lambda p: p == last):
            parts[path].replace(path)
        for folder in {path.parent for path in files}:
            _sync_folder(folder)
    except OSError as error:
        raise MapError(f"{error.filename or last}: cannot be written: {error.strerror or error}") from None
    finally:
        for part in parts.values():
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)


def remove_leftovers(folder: Path) -> None:
    """Remove what writers that were killed have left in a folder and below."""
    for part in folder.rglob(f".*{LEFTOVER_SUFFIX}"):
        with contextlib.suppress(OSError):
            part.unlink()


def _write_part(path: Path, content: bytes) -> Path:
    """Write to a name beside the final one: a rename within one folder is atomic."""
    part = path.with_name(f".{path.name}.{os.getpid()}{LEFTOVER_SUFFIX}")
    try:
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    except BaseException as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise
    return part


def _sync_folder(folder: Path) -> None:
    """Make the new names last through a power cut, where the file system can."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
