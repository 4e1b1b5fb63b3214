"""Writes a run in a format: a file or folder that is whole or not there."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

from meshslam.errors import ConfigError, MapError
from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import FORMATS, Notes
from meshslam.exporting.geojson import GeoOrigin
from meshslam.files import part_of


def export_content(
    run: FinishedRun, name: str, target: Path, origin: GeoOrigin | None = None, *, overwrite: bool = False
) -> Notes:
    """Write a run as a format of `FORMATS`; what could not be said in it comes back as notes.

    `origin` says where the map is on the earth, for formats that need it.

    ConfigError for an unknown format, a missing package, or an option that is missing; MapError where the target is
    there and `overwrite` is not set, or where the disk does not take it.
    """
    check_format(name, origin)
    chosen, target = FORMATS[name], Path(target)
    if target.exists() and not overwrite:
        raise MapError(f"{target}: is there already: choose another place, or give --overwrite to replace it")
    if target.exists() and target.is_dir() != chosen.is_folder:
        kinds = ("a file", "a folder") if target.is_dir() else ("a folder", "a file")
        raise MapError(f"{target}: is {kinds[1]}, {name} is {kinds[0]}: choose another place")
    part = part_of(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove(part)
        notes = chosen.write(run, part, origin)
        if target.is_dir():
            shutil.rmtree(target)
        part.replace(target)
    except OSError as error:
        raise MapError(f"{target}: cannot be written: {error.strerror or error}") from None
    finally:
        _remove(part)
    return notes


def check_format(name: str, origin: GeoOrigin | None = None) -> None:
    """ConfigError for a format that is unknown, that lacks its `origin`, or whose packages are not installed."""
    if name not in FORMATS:
        raise ConfigError(f"--format {name}: unknown, expected one of {', '.join(FORMATS)}")
    found = FORMATS[name]
    if found.needs_origin and origin is None:
        raise ConfigError(f"--format {name}: say where the map is on the earth: --origin LAT,LON[,HEIGHT[,HEADING]]")
    needed, extra = (*found.packages,), found.extra
    if found.takes_origin and origin is not None:
        needed, extra = (*needed, "pymap3d"), "geo"
    missing = [package for package in needed if importlib.util.find_spec(package) is None]
    if missing:
        raise ConfigError(
            f"--format {name}: needs {', '.join(missing)}, not installed: pip install 'meshslam[{extra}]'"
        )


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
