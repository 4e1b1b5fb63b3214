"""Settings as YAML, and YAML over settings: unknown keys and wrong types are errors that name the key."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import yaml

from meshslam.errors import ConfigError
from meshslam.runs.config import Config

Settings = TypeVar("Settings")


def read_config(path: Path | None) -> Config:
    """Defaults, with a YAML file's values over them; ConfigError names the file and the key that is wrong."""
    return Config() if path is None else overlaid(Config(), read_yaml(path), str(path))


def read_yaml(path: Path) -> Any:  # noqa: ANN401 # what a YAML file may hold
    """A YAML file's content; ConfigError names the file if it cannot be read."""
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such configuration file") from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: cannot be read as YAML: {' '.join(str(error).split())}") from None
    return document or {}


def to_yaml(config: Any) -> str:  # noqa: ANN401 # any dataclass
    """A configuration as YAML, every key."""
    text: str = yaml.safe_dump(_plain(dataclasses.asdict(config)), sort_keys=False, default_flow_style=False)
    return text


def _plain(value: Any) -> Any:  # noqa: ANN401 # a tree of plain values
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    return [_plain(entry) for entry in value] if isinstance(value, tuple | list) else value


def overlaid(settings: Settings, values: Any, where: str) -> Settings:  # noqa: ANN401 # what a YAML file may hold
    """`settings` with a mapping of values over them; unknown keys and wrong types are ConfigErrors."""
    if not isinstance(values, dict):
        raise ConfigError(f"{where}: expected keys with values, found {values!r}")
    assert dataclasses.is_dataclass(settings)
    assert not isinstance(settings, type)
    hints = get_type_hints(type(settings))
    changed: dict[str, Any] = {}
    for key, value in values.items():
        if key not in hints:
            raise ConfigError(f"{where}: unknown key {key!r}, known are {', '.join(hints)}")
        old = getattr(settings, key)
        inside = f"{where}: {key}"
        changed[key] = (
            overlaid(old, value, inside) if dataclasses.is_dataclass(old) else _typed(value, hints[key], inside)
        )
    return dataclasses.replace(settings, **changed)


def _typed(value: Any, hint: Any, where: str) -> Any:  # noqa: ANN401 # checked here
    """The value as its field's type, or a ConfigError."""
    options = get_args(hint)
    if get_origin(hint) is tuple and isinstance(value, list):
        return tuple(_typed(entry, options[0], where) for entry in value)
    if options and type(None) in options and value is None:
        return None
    kinds = [kind for kind in (options or (hint,)) if isinstance(kind, type) and kind is not type(None)]
    if float in kinds and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    literal = [kind for kind in options if isinstance(kind, str)]
    right = value in literal if literal else any(type(value) is kind for kind in kinds)
    if not right or (isinstance(value, float) and value != value):
        expected = " or ".join(literal or [kind.__name__ for kind in kinds])
        raise ConfigError(f"{where}: expected {expected}, found {value!r}")
    return value
