"""The index of a map in tiles: which tiles there are, in which files, with which content."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from meshslam.errors import MapError
from meshslam.files import must_exist

FORMAT, VERSION = "meshslam-city", 1
Key = tuple[int, int]  # column and row


@dataclass(frozen=True)
class TileEntry:
    """What the index says of a tile: its place in the grid, its files, how many objects, and their range of ids."""

    column: int  # the tile's objects have column * tile_m <= x < (column + 1) * tile_m
    row: int  # likewise along y
    objects: int
    first_id: int
    last_id: int
    table: str  # file names in `tiles`; they hold the beginning of the digests
    meshes: str
    table_digest: str  # blake2b of 16 bytes, hexadecimal
    meshes_digest: str
    bytes: int

    @property
    def key(self) -> Key:
        """Column and row."""
        return self.column, self.row


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
            "columns": list(TileEntry.__dataclass_fields__),
        }
        lines = ",\n".join(json.dumps(list(asdict(self.entries[key]).values())) for key in sorted(self.entries))
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
    entries = [_entry(values, document["columns"]) for values in document["tiles"]]
    categories = {str(name): _file_name(file) for name, file in document["categories"].items()}
    tile_m, generation = float(document["tile_m"]), int(document["generation"])
    return TileIndex(tile_m, {entry.key: entry for entry in entries}, categories, generation)


def _entry(values: list[Any], columns: list[str]) -> TileEntry:
    entry = TileEntry(**dict(zip(columns, values, strict=True)))
    _file_name(entry.table)
    _file_name(entry.meshes)
    return entry


def _file_name(name: str) -> str:
    """A name of a file in its folder; ValueError for one that leads elsewhere."""
    if not isinstance(name, str) or not name or set(name) & set("/\\:") or name.startswith("."):
        raise ValueError(f"{str(name)[:60]!r} is no name of a file in the map's folder")
    return name
