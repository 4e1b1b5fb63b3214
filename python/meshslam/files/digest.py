"""Values and files by their content: equal digests mean equal content."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

_BYTES = 16  # of a digest: chance equality is out of the question
_BLOCK = 1 << 20


def digest_of_file(path: Path) -> str:
    """Digest of a file's content, hexadecimal; OSError if it cannot be read."""
    found = hashlib.blake2b(digest_size=_BYTES)
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            found.update(block)
    return found.hexdigest()


def digest_of(value: Any) -> str:  # noqa: ANN401 # any tree of data
    """Digest of a tree of dataclasses, arrays, lists, mappings and plain values, hexadecimal."""
    found = hashlib.blake2b(digest_size=_BYTES)
    _feed(found, value)
    return found.hexdigest()


def _feed(found: hashlib.blake2b, value: Any) -> None:  # noqa: ANN401 # any tree of data
    """Kind, length and content of each part, so that no two trees look alike."""
    if isinstance(value, np.ndarray):
        found.update(f"array {value.dtype.str} {value.shape}".encode())
        found.update(np.ascontiguousarray(value).tobytes())
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        _feed(found, [type(value).__name__, {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}])
    elif isinstance(value, Mapping):
        _feed(found, [part for key in sorted(value, key=str) for part in (key, value[key])])
    elif isinstance(value, list | tuple):
        found.update(f"list {len(value)}".encode())
        for part in value:
            _feed(found, part)
    else:
        text = value if isinstance(value, bytes) else repr(value).encode()
        found.update(f"{type(value).__name__} {len(text)}".encode())
        found.update(text)
