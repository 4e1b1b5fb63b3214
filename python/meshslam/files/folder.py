"""A folder that is whole or not there: made aside, and put in the place of the one before."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from meshslam.errors import MeshslamError
from meshslam.files.atomic import LEFTOVER_SUFFIX, sync_file, sync_folder, write_into
from meshslam.files.places import real_path

LIST = ".meshslam-files.json"  # the names that were written


@contextlib.contextmanager
def replaced_folder(
    folder: Path, earlier: tuple[str, ...], check: Callable[[], None], error: type[MeshslamError]
) -> Iterator[Path]:
    """A folder aside for the block to fill; it becomes `folder` once it is on the disk, or goes.

    Files of the old folder that were not written so move along: its list tells, or the patterns `earlier` where it has
    none. `check` is called first and may refuse. A replacement that was cut short is ended, or taken back, before
    that. `error` names what the disk does not take.
    """
    folder = real_path(folder)
    part, old = (folder.with_name(f".{folder.name}.{kind}{LEFTOVER_SUFFIX}") for kind in ("new", "old"))
    try:
        _recover(folder, part, old)
        check()
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):  # a link that leads in a circle
            raise error(f"{folder}: is no folder that can be replaced: choose another place")
        part.mkdir(parents=True)
        yield part
        _write_list(part, error)
        if folder.exists():
            _take_along(folder, part, earlier, error)
        _put(folder, part, old)
    except OSError as problem:
        raise error(f"{problem.filename or folder}: cannot be written: {problem.strerror or problem}") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _recover(folder: Path, part: Path, old: Path) -> None:
    """The old folder comes back if it was moved away and the new one is not in place; what is left over goes."""
    if old.exists() and not folder.exists():
        old.rename(folder)
    if old.exists():
        _drop_old(folder, old)
    shutil.rmtree(part, ignore_errors=True)


def _write_list(part: Path, error: type[MeshslamError]) -> None:
    """List the files, and wait until all are on the disk."""
    names = sorted(_names(part))
    write_into(part / LIST, json.dumps({"files": names}, indent=1) + "\n", error)
    for name in (*names, LIST):
        sync_file(part / name)


def _take_along(folder: Path, part: Path, earlier: tuple[str, ...], error: type[MeshslamError]) -> None:
    """Give the files of others a second name in the new folder; `error` if one has a name that was written."""
    for name in sorted(_names(folder) - _listed(folder, earlier)):
        if (part / name).exists():
            raise error(f"{folder / name}: is in the way, and was not written with this folder: move it away")
        (part / name).parent.mkdir(parents=True, exist_ok=True)
        _link(folder / name, part / name)


def _put(folder: Path, part: Path, old: Path) -> None:
    """Move the new folder into the place of the old one, which comes back if that fails."""
    try:
        if folder.exists():
            folder.rename(old)
        part.rename(folder)
    except BaseException:
        if old.exists() and not folder.exists():
            old.rename(folder)
        raise
    try:
        sync_folder(folder.parent)
    finally:
        _end(folder, old)


def _end(folder: Path, old: Path) -> None:
    """Remove the old folder, even if Ctrl-C comes meanwhile."""
    try:
        if old.exists():
            _drop_old(folder, old)
    except OSError:
        raise
    except BaseException:
        if old.exists():
            _drop_old(folder, old)
        raise


def _drop_old(folder: Path, old: Path) -> None:
    """Remove the old folder; a file of others that came to it in the last moment moves to the new one."""
    for name in sorted(_names(old) - _listed(old, ())):
        if (old / LIST).is_file() and not (folder / name).exists():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (old / name).rename(folder / name)
    shutil.rmtree(old)


def _link(source: Path, target: Path) -> None:
    """The same file under a second name, or a copy where the file system has no links."""
    try:
        os.link(source, target, follow_symlinks=False)
    except OSError:
        shutil.copy2(source, target, follow_symlinks=False)


def _names(folder: Path) -> set[str]:
    """All files below a folder, links too."""
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_symlink() or not p.is_dir()}


def _listed(folder: Path, earlier: tuple[str, ...]) -> set[str]:
    """The files that were written with a folder."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        return {LIST, *json.loads((folder / LIST).read_text(encoding="utf-8"))["files"]}
    return {str(p.relative_to(folder)) for pattern in earlier for p in folder.glob(pattern)}
