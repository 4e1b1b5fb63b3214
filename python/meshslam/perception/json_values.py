"""Values of a JSON file: taken as what they should be, or a DetectionError that names the key and quotes the value."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from meshslam.errors import DetectionError
from meshslam.perception.masks import is_finite_number

LARGEST_NUMBER = 2**53  # of ids: beyond, a float does not hold every integer
QUOTED = 60  # characters of a wrong value that a message repeats


def load_json(path: Path) -> Any:  # noqa: ANN401 # any JSON
    """What a JSON file holds, a byte order mark at its start or not; DetectionError if it cannot be read."""
    try:
        return json.loads(path.read_bytes())
    except OSError as error:
        raise unreadable(path, error) from None
    except (ValueError, RecursionError) as error:
        raise not_json(path, error) from None


def unreadable(path: Path, error: OSError) -> DetectionError:
    """The error of a file that the disk does not give."""
    return DetectionError(f"{path}: cannot be read: {error.strerror or error}")


def not_json(path: Path, error: Exception) -> DetectionError:
    """The error of a file that is no JSON."""
    return DetectionError(f"{path}: is no JSON: {str(error)[: 2 * QUOTED]}")


def quoted(value: object) -> str:
    """A value in at most 60 printable characters of one line."""
    try:
        return json.dumps(value)[:QUOTED]
    except (TypeError, ValueError, RecursionError):
        return kind(value)


def kind(value: object) -> str:
    """What a value of JSON is, in words."""
    names = {
        dict: "an object",
        list: "a list",
        str: "a string",
        bool: "true or false",
        int: "a number",
        float: "a number",
    }
    return names.get(type(value), "null")


def integer(row: dict[str, Any], key: str, least: int = 0) -> int:
    """The integer under `key`, from `least` to 2^53; DetectionError otherwise."""
    if key not in row:
        raise DetectionError(f"{key}: is missing, expected an integer")
    value = row[key]
    if type(value) is not int or not least <= value <= LARGEST_NUMBER:
        size = "from 0 to 2^53" if least == 0 else "of at most 2^53"
        raise DetectionError(f"{key}: found {quoted(value)}, expected an integer {size}")
    return value


def text(row: dict[str, Any], key: str, default: str | None = None) -> str:
    """The name under `key`; DetectionError if it is none, is empty or is no Unicode."""
    value = row.get(key, default)
    if not isinstance(value, str) or not value or not _is_unicode(value):
        found = f"found {quoted(value)}" if key in row else "is missing"
        raise DetectionError(f"{key}: {found}, expected a name")
    return value


def is_name(value: object) -> bool:
    """Whether a value is a text that can be written again."""
    return isinstance(value, str) and _is_unicode(value)


def _is_unicode(value: str) -> bool:
    return not any("\ud800" <= character <= "\udfff" for character in value)


def number(value: object, key: str, largest: float = float("inf")) -> float:
    """A finite number of at most `largest` in size; DetectionError otherwise."""
    if not is_finite_number(value) or abs(value) > largest:
        size = "a finite number" if largest == float("inf") else f"a number within {largest:g}"
        raise DetectionError(f"{key}: found {quoted(value)}, expected {size}")
    return float(value)
