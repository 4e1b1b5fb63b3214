"""Names of the class numbers that other tools write."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from meshslam.errors import DetectionError, SequenceError
from meshslam.perception.json_values import is_name, quoted
from meshslam.sequences import parsed_yaml


def read_class_names(given: str) -> dict[int, str]:
    """Names by class number, counted from 0: `car,truck`, `0=car,7=truck`, or a file.

    A file is YAML with `names`, a list or numbers with names, as Ultralytics' data.yaml has them; or text with a name a
    line. DetectionError says what is wrong.
    """
    path = Path(given)
    return _of_file(path) if path.is_file() else _of_list(given.split(","), "--names")


def _of_file(path: Path) -> dict[int, str]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError):
        raise DetectionError(f"{path}: cannot be read as text") from None
    try:
        content = parsed_yaml(path, text)
    except SequenceError:
        content = None
    names = content.get("names") if isinstance(content, dict) else content
    if isinstance(names, dict):
        return _checked(names, str(path))
    if isinstance(names, list):
        return _checked(dict(enumerate(names)), str(path))
    if isinstance(content, dict) or path.suffix in (".yaml", ".yml"):
        raise DetectionError(f"{path}: names: expected a list of class names, or numbers with names")
    return _of_list(text.splitlines(), str(path))


def _of_list(words: list[str], where: str) -> dict[int, str]:
    entries = [word.strip() for word in words if word.strip()]
    if not any("=" in entry for entry in entries):
        return _checked(dict(enumerate(entries)), where)
    found: dict[object, object] = {}
    for entry in entries:
        number, _, name = (part.strip() for part in entry.partition("="))
        found[int(number) if number.isascii() and number.isdigit() and len(number) < 10 else number] = name
    return _checked(found, where)


def _checked(names: Mapping[object, object], where: str) -> dict[int, str]:
    found = {}
    for number, name in names.items():
        if type(number) is not int or number < 0 or not is_name(name) or not name:
            raise DetectionError(f"{where}: found {quoted(number)}: {quoted(name)}, expected a class number and a name")
        found[number] = str(name)
    if not found:
        raise DetectionError(f"{where}: holds no class names")
    return found


def class_note(path: Path, used: Mapping[int, int], names: Mapping[int, str], *, given: bool) -> tuple[str, ...]:
    """Say by which names the class numbers were read, and how many detections have each; nothing without detections."""
    most = sorted(used, key=lambda number: -used[number])[:3]
    said = ", ".join(f"{number} = {quoted(names[number])[1:-1]} ({used[number]})" for number in most)
    whose = "the names given" if given else "COCO's names (--names gives others)"
    return (f"{path}: class numbers are read by {whose}: {said}",) if used else ()
