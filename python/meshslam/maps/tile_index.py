"""The index of a map in tiles: which tiles there are, in which files, with which content."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from meshslam.errors import MapError
from meshslam.files import must_exist

FORMAT, VERSION = "meshslam-city", 2
Key = tuple[int, int]  # column and row
_DIGEST = re.compile("[0-9a-f]{32}")


class TileEntry(NamedTuple):
    """What the index says of a tile: its place in the grid, its objects, and what its files hold."""

    column: int  # the tile's objects have column * tile_m <= x < (column + 1) * tile_m
    row: int  # likewise along y
    objects: int
    first_id: int
    last_id: int
    bytes: int  # of both files
    table_digest: str  # blake2b of 16 bytes, hexadecimal
    meshes_digest: str

    @property
    def key(self) -> Key:
        """Column and row."""
        return self.column, self.row

    @property
    def table(self) -> str:
        """Name of the file with the objects' table."""
        return f"{self.column}_{self.row}.{self.table_digest[:12]}.objects.npz"

    @property
    def meshes(self) -> str:
        """Name of the file with the meshes."""
        return f"{self.column}_{self.row}.{self.meshes_digest[:12]}.meshes.npz"


@dataclass(eq=False)
class TileIndex:
    """All tiles by column and row, and the shape spaces that their meshes are written by."""

    tile_m: float
    entries: dict[Key, TileEntry] = field(default_factory=dict)
    categories: dict[str, str] = field(default_factory=dict)  # name to file in `categories`
    generation: int = 0  # how often the map was written to

    def to_bytes(self) -> bytes:
        """The file: JSON with a line a tile."""
        document = {
            "format": FORMAT,
            "version": VERSION,
            "generation": self.generation,
            "tile_m": self.tile_m,
            "objects": sum(entry.objects for entry in self.entries.values()),
            "categories": dict(sorted(self.categories.items())),
            "columns": list(TileEntry._fields),
        }
        lines = ",\n".join(json.dumps(self.entries[key]) for key in sorted(self.entries))
        head = json.dumps(document, indent=1).removesuffix("\n}")
        return f'{head},\n "tiles": [\n{lines}\n]\n}}\n'.encode()


def read_index(file: Path) -> TileIndex:
    """The reverse of `to_bytes`; MapError, naming the file, if there is none, or it is damaged."""
    must_exist(file, "map in tiles", MapError)
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
        found = document.get("format"), document.get("version")
        if found == (FORMAT, VERSION):
            return _index(document)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise MapError(f"{file}: is damaged: {' '.join(str(error).split())[:150]}") from None
    raise MapError(f"{file}: found {str(found[0])[:60]!r} version {found[1]!r}, expected {FORMAT!r} version {VERSION}")


def _index(document: dict[str, Any]) -> TileIndex:
    if tuple(document["columns"]) != TileEntry._fields:
        raise ValueError(f"columns: expected {list(TileEntry._fields)}")
    entries = [TileEntry._make(values) for values in document["tiles"]]
    _check(entries)
    categories = {str(name): _file_name(file) for name, file in document["categories"].items()}
    tile_m, generation = float(document["tile_m"]), int(document["generation"])
    return TileIndex(tile_m, {entry.key: entry for entry in entries}, categories, generation)


def _check(entries: list[TileEntry]) -> None:
    """ValueError for anything but whole numbers and digests: file names are made of these."""
    numbers = np.array([entry[:6] for entry in entries] or np.zeros((0, 6), int))
    if numbers.dtype.kind != "i":
        raise ValueError("tiles: expected whole numbers")
    for entry in entries:
        if not (_DIGEST.fullmatch(entry.table_digest) and _DIGEST.fullmatch(entry.meshes_digest)):
            raise ValueError(f"tile {entry.key}: its digests are not 32 hexadecimal digits")


def _file_name(name: str) -> str:
    """A name of a file in its folder; ValueError for one that leads elsewhere."""
    if not isinstance(name, str) or not name or set(name) & set("/\\:") or name.startswith("."):
        raise ValueError(f"{str(name)[:60]!r} is no name of a file in the map's folder")
    return name
