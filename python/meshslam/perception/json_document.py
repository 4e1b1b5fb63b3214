"""A JSON object with one long list whose entries are parsed one by one: of a large file only its text is held."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from json.decoder import WHITESPACE  # type: ignore[attr-defined] # a compiled pattern, which the stubs leave out
from pathlib import Path
from typing import Any

from meshslam.perception.json_values import not_json, unreadable

_DECODER = json.JSONDecoder()


@dataclass(frozen=True)
class Entries:
    """The entries of a list that is known to be sound JSON; each is parsed when its turn comes."""

    text: str
    begin: int  # of the list's bracket
    count: int

    def __iter__(self) -> Iterator[Any]:
        at = _blank(self.text, self.begin + 1)
        while self.text[at] != "]":
            entry, at = _DECODER.raw_decode(self.text, at)
            yield entry
            at = _blank(self.text, at)
            at = _blank(self.text, at + 1) if self.text[at] == "," else at

    def __len__(self) -> int:
        return self.count


def load_with_entries(path: Path, key: str) -> Any:  # noqa: ANN401 # any JSON
    """What a JSON file holds; where that is an object, its list under `key` as Entries.

    DetectionError if it cannot be read, as of `load_json`.
    """
    try:
        content = path.read_bytes()
        text = content.decode(json.detect_encoding(content), "surrogatepass")
        del content
        found = _object(text, key)
        return json.loads(text) if found is None else found
    except OSError as error:
        raise unreadable(path, error) from None
    except (ValueError, RecursionError) as error:
        raise not_json(path, error) from None


def _object(text: str, key: str) -> dict[str, Any] | None:
    """The object that a text is, without what is under `key`; None where it is no JSON, or none of an object."""
    try:
        at, found = _after(text, 0, "{"), dict[str, Any]()
        while text[at] != "}":
            name, at = _DECODER.raw_decode(text, at)
            at = _after(text, at, ":")
            found[name], at = _entries(text, at) if name == key and text[at] == "[" else _DECODER.raw_decode(text, at)
            at = _blank(text, at)
            if text[at] == "," and text[_after(text, at, ",")] != "}":
                at = _after(text, at, ",")
            elif text[at] != "}":
                return None
        is_whole = _blank(text, at + 1) == len(text) and all(isinstance(name, str) for name in found)
    except (ValueError, IndexError, RecursionError):
        return None
    return found if is_whole else None


def _entries(text: str, begin: int) -> tuple[Entries, int]:
    """The list at a place, and where it ends; ValueError or IndexError if it is no sound one."""
    at, count = _after(text, begin, "["), 0
    while text[at] != "]":
        _, at = _DECODER.raw_decode(text, at)
        count += 1
        at = _blank(text, at)
        if text[at] == "," and text[_after(text, at, ",")] != "]":
            at = _after(text, at, ",")
        elif text[at] != "]":
            raise ValueError(at)
    return Entries(text, begin, count), at + 1


def _after(text: str, at: int, sign: str) -> int:
    """The first place that is not blank after a sign, which blanks may precede."""
    at = _blank(text, at)
    if text[at] != sign:
        raise ValueError(at)
    return _blank(text, at + 1)


def _blank(text: str, at: int) -> int:
    end: int = WHITESPACE.match(text, at).end()
    return end
