"""A drive's settings: its own over the fleet's, with files by their whole paths, as every machine must find them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from meshslam.errors import ConfigError
from meshslam.files import real_path
from meshslam.fleet.urls import is_url
from meshslam.runs import Config, configured, overlaid, uses
from meshslam.settings import paths_of

EXPERT = "expert"
FILES = (
    "input.camera_file",
    "input.times",
    "input.adapter",
    "input.detections",
    "input.map",
    "input.imu",
    "input.imu_from_camera",
    "input.poses",
    "input.camera_from_body",
    "keypoints.model",
)
NAMES = {"input.segmenter": ".onnx", "input.category": ".npz"}  # files or names of what is shipped or stored


def merged(common: object, own: object, command: str, where: str) -> dict[str, Any]:
    """A drive's own settings over those of all that its command uses."""
    if own is not None and not isinstance(own, dict):
        raise ConfigError(f"{where}: expected settings with values, found {own!r}")
    return _over(_used(common if isinstance(common, dict) else {}, command), own or {})


def drive_settings(document: dict[str, Any], where: str, command: str, folder: Path, recording: str) -> Config:
    """The settings of a drive; ConfigError names what is wrong. `folder` is where relative paths begin."""
    settings = configured(document, where, command)
    if settings.input.sequence:
        raise ConfigError(f"{where}: input.sequence: the drive's recording takes its place: leave it out")
    if command == "localize" and settings.input.map is None:
        raise ConfigError(f"{where}: input.map: localize needs a run, its map.json, or an objects.json")
    values: dict[str, Any] = {"input": {"sequence": recording}}
    for path in (*FILES, *NAMES):
        group, name = path.split(".")
        given = getattr(getattr(settings, group), name)
        if isinstance(given, str) and _is_file(path, given, folder):
            values.setdefault(group, {})[name] = str(real_path(folder / given))
    return overlaid(settings, values, where)


def _is_file(path: str, given: str, folder: Path) -> bool:
    ending = NAMES.get(path)
    return not is_url(given) and (ending is None or given.endswith(ending) or (folder / given).is_file())


def _used(tree: Mapping[Any, Any], command: str, before: str = "") -> dict[Any, Any]:
    """The part of the common settings that a command uses; what is unknown stays, to be told."""
    kept: dict[Any, Any] = {}
    for key, value in tree.items():
        path = f"{before}{key}"
        if key == EXPERT and not before:
            kept[key] = _used(value, command)
        elif isinstance(value, dict):
            kept[key] = _used(value, command, f"{path}.")
        elif path not in paths_of(Config) or uses(command, path):
            kept[key] = value
    return kept


def _over(common: Mapping[Any, Any], own: Mapping[Any, Any]) -> dict[Any, Any]:
    """One tree over another."""
    both = {key for key in own if isinstance(own[key], dict) and isinstance(common.get(key), dict)}
    return {**common, **own, **{key: _over(common[key], own[key]) for key in both}}
