"""Places that are paths, or URLs that fsspec reads."""

from __future__ import annotations

import glob
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from meshslam.errors import ConfigError, MeshslamError, SequenceError
from meshslam.files import LOCK, digest_of, locked, wait_until_free


def is_url(place: str) -> bool:
    """Whether a place is a URL, such as s3://drives/1."""
    return "://" in place


def has_pattern(place: str) -> bool:
    """Whether a place stands for all that match it."""
    return any(sign in place for sign in "*?[")


def matching(pattern: str, folder: Path) -> list[str]:
    """Folders that match a pattern, sorted; files where no folder does."""
    if is_url(pattern):
        system, path = file_system(pattern)
        found = {system.unstrip_protocol(name): system.isdir(name) for name in system.glob(path)}
    else:
        found = {name: (folder / name).is_dir() for name in _found(pattern, folder)}
    return sorted(name for name, is_folder in found.items() if is_folder or not any(found.values()))


def _found(pattern: str, folder: Path) -> list[str]:
    """What matches, as the pattern is written: absolute, or relative to the folder."""
    return glob.glob(pattern, root_dir=folder)  # noqa: PTH207 # Path.glob takes no absolute pattern


def file_system(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it; ConfigError if there is none for it."""
    try:
        import fsspec
    except ImportError:
        raise ConfigError(f'{url}: URLs need fsspec: pip install "meshslam[ray]"') from None
    try:
        found: tuple[Any, str] = fsspec.core.url_to_fs(url)
    except (ImportError, ValueError) as problem:  # of a protocol that is unknown, or that needs a package
        raise ConfigError(f"{url}: cannot be opened: {' '.join(str(problem).split())}") from None
    return found


@contextmanager
def downloaded(url: str, name: str) -> Iterator[Path]:
    """A recording of a URL on this machine's disk while the block runs; it is at the same path on every machine.

    The path is in a run's configuration. `name` is the drive's: others may use the same recording at the same time.
    """
    place = Path(tempfile.gettempdir()) / f"meshslam-fleet-{os.getuid()}" / digest_of([url, name])
    place.mkdir(parents=True, exist_ok=True)
    wait_until_free(place / LOCK)
    with locked(place / LOCK, url):
        recording = place / Path(url.rstrip("/")).name
        try:
            _remove(recording)
            _download(url, recording)
            yield recording
        finally:
            _remove(recording)


def _download(url: str, to: Path) -> None:
    """SequenceError if it cannot be read."""
    system, path = file_system(url)
    try:
        if not system.exists(path):
            raise SequenceError(f"{url}: no such folder or file")
        system.get(path.rstrip("/"), str(to), recursive=True)
    except MeshslamError:
        raise
    except Exception as problem:  # each protocol has its own errors
        raise SequenceError(f"{url}: cannot be read: {' '.join(str(problem).split())}") from None


def _remove(recording: Path) -> None:
    if recording.is_dir():
        shutil.rmtree(recording)
    recording.unlink(missing_ok=True)
