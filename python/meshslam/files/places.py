"""Where a path leads."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from meshslam.errors import MeshslamError


def real_path(path: Path | str) -> Path:
    """The absolute path without links, as far as they lead anywhere; `Path.resolve` raises for links in a circle."""
    return Path(os.path.realpath(path))


CITY = "city.json"  # the index of a map in tiles


def map_file(path: Path) -> Path:
    """The file of a map that a run directory, a map in tiles, or the file itself names."""
    if not path.is_dir():
        return path
    return path / CITY if (path / CITY).is_file() else path / "map.json"


def must_exist(path: Path, what: str, error: type[MeshslamError]) -> None:
    """Raise the error if nothing is at a path; `what` says what was expected there.

    What is there but cannot be looked at is told when it is read.
    """
    try:
        os.stat(path)  # noqa: PTH116 # a name that no file can have is a ValueError
    except (FileNotFoundError, NotADirectoryError, ValueError):
        raise error(f"{path}: no such {what}") from None
    except OSError as trouble:
        if trouble.errno == errno.ELOOP:  # links in a circle lead nowhere
            raise error(f"{path}: no such {what}") from None
