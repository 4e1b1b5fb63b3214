"""A run directory as bytes: how it travels where no folder is shared."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from meshslam.files import LEFTOVER_SUFFIX, LOCK

Files = Mapping[str, bytes]
Changes = Mapping[str, bytes | None]


def files_of(folder: Path) -> dict[str, bytes]:
    """Every file of a run directory by its name in it, less locks and what a killed writer left."""
    found = (path for path in sorted(folder.rglob("*")) if path.is_file() and not is_passing(path.name))
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def is_passing(name: str) -> bool:
    """Whether a file is there only while something is written."""
    return name.endswith((LOCK, LEFTOVER_SUFFIX))


def put_files(folder: Path, files: Files) -> None:
    """Make a run directory of files."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def changes_of(folder: Path, before: Files) -> dict[str, bytes | None]:
    """What is another in a run directory than it was: new content, None for files that are gone."""
    now = files_of(folder)
    changed: dict[str, bytes | None] = {name: content for name, content in now.items() if before.get(name) != content}
    return changed | {name: None for name in before if name not in now}
