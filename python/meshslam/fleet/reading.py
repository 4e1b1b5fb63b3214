"""A fleet file (YAML): drives one by one or by a pattern. What is wrong is named by file, drive and key."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from meshslam.errors import ConfigError
from meshslam.files import must_exist, real_path
from meshslam.fleet.drive_settings import drive_settings, merged
from meshslam.fleet.drives import Drive, Fleet, Needs
from meshslam.fleet.urls import has_pattern, is_url, matching
from meshslam.runs import DETECT, RUNS, TRACK, configured, read_yaml

KEYS = {
    "": ("drives", "recordings", "defaults", "resources"),
    "defaults": ("command", "settings"),
    "drive": ("name", "recording", "recordings", "command", "settings"),
}
STEPS = (DETECT, TRACK, *RUNS)
SAFE = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


def read_fleet(path: Path) -> Fleet:
    """The drives of a fleet file; ConfigError for what cannot be meant, before anything is run.

    Paths are relative to the file. A recording that is missing or damaged is not an error here: its drive fails alone.
    """
    must_exist(path, "fleet file", ConfigError)
    content = read_yaml(path)
    document = {"drives": content} if isinstance(content, list) else _mapping(content, str(path), KEYS[""])
    defaults = _mapping(document.get("defaults"), f"{path}: defaults", KEYS["defaults"])
    configured(defaults.get("settings"), f"{path}: defaults: settings")
    entries = [*_listed(path, document.get("drives")), *_patterns(document)]
    folder = real_path(path).parent
    drives = [drive for entry in entries for drive in _drives(path, folder, entry, defaults)]
    if not drives:
        raise ConfigError(f"{path}: no drive is listed: give `recordings: drives/*`, or a list under `drives`")
    _refuse_same_names(path, drives)
    return Fleet(path, tuple(drives), dict(_needs(path, document.get("resources"))))


def _listed(path: Path, entries: object) -> Iterator[dict[str, Any]]:
    """Entries of the list, a text being a recording or a pattern of recordings."""
    if entries is not None and not isinstance(entries, list):
        raise ConfigError(f"{path}: drives: expected a list, found {entries!r}")
    for number, entry in enumerate(entries or [], 1):
        if isinstance(entry, str):
            yield {"recordings" if has_pattern(entry) else "recording": entry}
            continue
        where = f"{path}: drive {number}"
        found = _mapping(entry, where, KEYS["drive"])
        if ("recording" in found) == ("recordings" in found):
            raise ConfigError(f"{where}: give it `recording`, or `recordings` with a pattern")
        yield found


def _patterns(document: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    given = document.get("recordings")
    for pattern in given if isinstance(given, list) else [] if given is None else [given]:
        yield {"recordings": pattern}


def _drives(path: Path, folder: Path, entry: dict[str, Any], defaults: Mapping[str, Any]) -> Iterator[Drive]:
    """The drive of an entry, or one for each match of its pattern."""
    where = f"{path}: {entry.get('name') or entry.get('recording') or entry.get('recordings')}"
    if "recordings" not in entry:
        yield _drive(where, folder, str(entry["recording"]), entry, defaults)
        return
    if "name" in entry:
        raise ConfigError(f"{where}: name: a pattern's drives are named by their folders: leave it out")
    found = matching(str(entry["recordings"]), folder)
    if not found:
        raise ConfigError(f"{where}: recordings: nothing matches, in {folder}")
    yield from (_drive(f"{path}: {recording}", folder, recording, entry, defaults) for recording in found)


def _drive(where: str, folder: Path, recording: str, entry: Mapping[str, Any], defaults: Mapping[str, Any]) -> Drive:
    name = str(entry.get("name", "")) or name_of(recording)
    if not SAFE.fullmatch(name):
        raise ConfigError(f"{where}: name: {name!r} becomes a folder: letters, digits, dots, - and _ only")
    command = entry.get("command", defaults.get("command", "map"))
    if command not in RUNS:
        raise ConfigError(f"{where}: command: expected {', '.join(RUNS)}, found {command!r}")
    place = recording if is_url(recording) else str(real_path(folder / recording))
    document = merged(defaults.get("settings"), entry.get("settings"), str(command), f"{where}: settings")
    return Drive(name, place, str(command), drive_settings(document, f"{where}: settings", str(command), folder, place))


def name_of(recording: str) -> str:
    """The name of a drive that has none: that of its folder or file, with _ for what no folder should hold."""
    last = PurePosixPath(recording.rstrip("/"))
    name = last.stem if last.suffix in (".bag", ".mcap", ".mp4", ".avi", ".mkv", ".mov") else last.name
    return re.sub(r"[^A-Za-z0-9._-]", "_", name).lstrip("._-")[:100]


def _refuse_same_names(path: Path, drives: list[Drive]) -> None:
    seen: dict[str, Drive] = {}
    for drive in drives:
        other = seen.setdefault(drive.name.lower(), drive)
        if other is not drive:
            raise ConfigError(
                f"{path}: two drives are called {drive.name}, {other.recording} and {drive.recording}: give them names"
            )


def _needs(path: Path, given: object) -> Iterator[tuple[str, Needs]]:
    """What steps need, by the step."""
    for step, amounts in _mapping(given, f"{path}: resources", STEPS).items():
        where, known = f"{path}: resources: {step}", _mapping(amounts, f"{path}: resources: {step}")
        for name, amount in known.items():
            if isinstance(amount, bool) or not isinstance(amount, int | float) or not 0 <= amount < 1e9:
                raise ConfigError(f"{where}: {name}: expected how many, found {amount!r}")
        own = {name: float(known.pop(name)) for name in ("cpus", "gpus", "memory_mb") if name in known}
        yield step, Needs(**own, others={str(name): float(amount) for name, amount in known.items()})


def _mapping(value: object, where: str, keys: tuple[str, ...] = ()) -> dict[str, Any]:
    """The value's keys and values, of which none is unknown."""
    if value is not None and not isinstance(value, dict):
        raise ConfigError(f"{where}: expected keys with values, found {value!r}")
    unknown = [key for key in value or {} if keys and key not in keys]
    if unknown:
        raise ConfigError(f"{where}: {unknown[0]}: no such key: there are {', '.join(keys)}")
    return dict(value or {})
