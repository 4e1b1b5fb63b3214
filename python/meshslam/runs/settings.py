"""Settings as YAML, and YAML over settings: what is unknown, out of range or not used is an error that names it.

A file holds public settings at their place and expert ones in the same tree under `expert`.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml

from meshslam.errors import ConfigError, SequenceError
from meshslam.files import must_exist
from meshslam.runs.commands import uses, why_unused
from meshslam.runs.config import Config
from meshslam.runs.names import advice, written
from meshslam.sequences import parsed_yaml
from meshslam.settings import Setting, Settings, parts_of, paths_of, settings_of

EXPERT = "expert"
Some = TypeVar("Some", bound=Settings)


def read_config(path: Path | None, command: str | None = None) -> Config:
    """Defaults, with a YAML file's values over them.

    ConfigError names the file and the setting that is unknown, out of range, at the wrong place, or not used by the
    command.
    """
    return Config() if path is None else configured(read_yaml(path), str(path), command)


def configured(document: object, where: str, command: str | None = None) -> Config:
    """The configuration that a file's content makes; `where` names it in errors, which are as for `read_config`."""
    known = paths_of(Config)
    tree = dict(_mapping(document, where))
    values: dict[str, Any] = {}
    for kind, content in (("expert", tree.pop(EXPERT, None)), ("public", tree)):
        for path, value in _given(Config, content, where, known, command):
            if known[path].about.kind != kind:
                raise ConfigError(f"{where}: {_misplaced(path, value, known)}")
            if command is not None and not uses(command, path):
                raise ConfigError(f"{where}: {why_unused(command, path)}")
            _put(values, path, value)
    return overlaid(Config(), values, where)


def _given(
    kind: type, values: object, where: str, known: Mapping[str, Setting], command: str | None, before: str = ""
) -> Iterator[tuple[str, object]]:
    """Paths and values of what a file's content gives."""
    for key, value in _mapping(values, where, before).items():
        path = f"{before}{key}"
        if key in parts_of(kind):
            yield from _given(parts_of(kind)[key], value, where, known, command, f"{path}.")
        elif key in settings_of(kind):
            yield path, value
        else:
            raise ConfigError(f"{where}: {advice(path, value, known, command)}")


def _misplaced(path: str, value: object, known: Mapping[str, Setting]) -> str:
    what = "an expert setting: it stands under" if known[path].about.kind == "expert" else "a public setting: not under"
    return f"{path} is {what} expert, write {written(path, value, known)}"


def read_yaml(path: Path) -> object:
    """A YAML file's content; ConfigError names the file if it cannot be read."""
    must_exist(path, "configuration file", ConfigError)
    try:
        document: object = parsed_yaml(path, path.read_text(encoding="utf-8-sig"), _Loader)
    except SequenceError as error:
        raise ConfigError(str(error)) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read as YAML: {_one_line(error)}") from None
    return document or {}


def _one_line(error: Exception) -> str:
    return " ".join(str(error).replace('"<unicode string>", ', "").split())


def to_yaml(config: Settings, command: str | None = None) -> str:
    """A configuration as YAML, public settings first; of a command's, only those that it uses."""
    tree: dict[str, Any] = {}
    rows = [(path, s) for path, s in paths_of(type(config)).items() if command is None or uses(command, path)]
    for path, known in sorted(rows, key=lambda row: row[1].about.kind == "expert"):
        value: Any = config
        for name in path.split("."):
            value = getattr(value, name)
        _put(tree, f"{EXPERT}.{path}" if known.about.kind == "expert" else path, _plain(value))
    text: str = yaml.safe_dump(tree, sort_keys=False, default_flow_style=False, allow_unicode=True)
    return text


def overlaid(settings: Some, values: object, where: str, before: str = "") -> Some:
    """`settings` with a mapping of values over them; unknown names and wrong values are ConfigErrors.

    Errors begin with `where`; `before` is what stands before a setting's name, such as `slam.points.`.
    """
    kind: type = type(settings)
    changed: dict[str, Any] = {}
    for key, value in _mapping(values, where, before).items():
        if key in parts_of(kind):
            changed[key] = overlaid(getattr(settings, key), value, where, f"{before}{key}.")
        elif key in settings_of(kind):
            changed[key] = _converted(settings_of(kind)[key], value)
        else:
            raise ConfigError(f"{where}: {advice(f'{before}{key}', value, paths_of(kind, before))}")
    everything = vars(settings) | changed
    for name, known in settings_of(kind).items():
        problem = known.problem(everything[name], everything)
        if problem is not None:
            raise ConfigError(f"{where}: {before}{name}: {problem}")
    return dataclasses.replace(settings, **changed)


def _mapping(values: object, where: str, before: str = "") -> dict[Any, Any]:
    if values is not None and not isinstance(values, dict):
        place = f"{where}: {before.rstrip('.')}" if before else where
        raise ConfigError(f"{place}: expected settings with values, found {values!r}")
    return values or {}


def _converted(known: Setting, value: object) -> object:
    """Lists as tuples; whole numbers as the floats that they stand for."""
    if known.is_list and isinstance(value, list):
        return tuple(value)
    if float in known.types and type(value) is int and abs(value) < 2**53:
        return float(value)
    return value


def _plain(value: object) -> object:
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    return value.item() if isinstance(value, np.generic) else value


def _put(tree: dict[str, Any], path: str, value: object) -> None:
    *groups, name = path.split(".")
    for group in groups:
        tree = tree.setdefault(group, {})
    tree[name] = value


class _Loader(yaml.SafeLoader):
    """YAML as its version 1.2 has it: 1e-3 is a number, and no key stands twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Refuse a key that would hide another."""
        seen: set[str] = set()
        for key, _ in node.value:
            if str(key.value) in seen:
                raise yaml.constructor.ConstructorError(None, None, f"{key.value} stands twice", key.start_mark)
            seen.add(str(key.value))
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
)
