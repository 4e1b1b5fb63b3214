"""A map of a city: a folder of tiles, read where it is asked, written tile by tile."""

from __future__ import annotations

import hashlib
import re
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.categories import Category, category_bytes, category_names, load_category
from meshslam.errors import CategoryError, MapError
from meshslam.files import CITY, LOCK, digest_of, locked, remove_leftovers, write_atomically, write_together
from meshslam.geometry import Floats, Ints
from meshslam.maps.constellation_index import ConstellationIndex
from meshslam.maps.map import Map, checked_place
from meshslam.maps.objects import MapObject
from meshslam.maps.tile import Tile
from meshslam.maps.tile_index import Key, TileEntry, TileIndex, read_index

TILE_M = 100.0
_TILES, _CATEGORIES = "tiles", "categories"
_HELD_OBJECTS = 4000  # of the tiles that are kept in memory, packed
_UNSAFE = re.compile("[^A-Za-z0-9_-]")  # in a file name
_STEP_SHARE = 0.1  # of a radius: a path is looked along in such steps


@dataclass(eq=False)
class TiledMap(Mapping[int, MapObject]):
    """Objects in one world, in metres, in tiles on a square grid; tiles are read when they are needed.

    A mapping of id to MapObject, like Map, that iterates by tiles. Poses are exact. Meshes of a category's topology are
    rounded to half millimetres, sigmas of vertices to 2%; other meshes, covariances and mask IoU are kept in single
    precision. A map that is open keeps what it was when it was opened until another has written to its folder twice;
    MapError then says to open it again.

    Example:
        city = meshslam.Map.open("city")
        for thing in city.near(position, 50.0):
            thing.vertices_in_world

    """

    folder: Path
    index: TileIndex
    _models: dict[str, Category] = field(default_factory=dict, repr=False)
    _held: OrderedDict[Key, Tile] = field(default_factory=OrderedDict, repr=False)

    @staticmethod
    def is_at(path: Path | str) -> bool:
        """Whether a path is a folder with tiles, or its index."""
        path = Path(path)
        return path.name == CITY if path.is_file() else (path / CITY).is_file()

    @staticmethod
    def open(path: Path | str) -> TiledMap:
        """Read the index; MapError if there is none, or it is damaged."""
        folder = Path(path).parent if Path(path).name == CITY else Path(path)
        index = read_index(folder / CITY)
        return TiledMap(folder, index)

    @staticmethod
    def create(folder: Path | str, *, tile_m: float = TILE_M) -> TiledMap:
        """Begin an empty one; MapError where there is one already."""
        folder = Path(folder)
        if not 1.0 <= tile_m <= 1e5:
            raise MapError(f"tiles of {tile_m} m: 1 to 100000 m are possible")
        if (folder / CITY).exists():
            raise MapError(f"{folder}: holds a map in tiles already: open it, or choose another folder")
        city = TiledMap(folder, TileIndex(float(tile_m)))
        try:
            for name in (_TILES, _CATEGORIES):
                (folder / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise MapError(f"{folder}: cannot be made: {error.strerror}") from None
        write_atomically(folder / CITY, city.index.to_bytes())
        return city

    def __len__(self) -> int:
        return sum(entry.objects for entry in self.index.entries.values())

    def __iter__(self) -> Iterator[int]:
        for key in sorted(self.index.entries):
            yield from self._tile(key).ids.tolist()

    def __getitem__(self, number: int) -> MapObject:
        for key in self._keys_with(number):
            tile = self._tile(key)
            if (tile.ids == number).any():
                return self._named(key, tile, tile.ids == number)[0]
        raise KeyError(f"the map has no object {number}")

    def near(self, position_m: Floats, radius_m: float) -> tuple[MapObject, ...]:
        """Objects whose centres are within `radius_m` of a position, (2,) on the ground or (3,), by ascending id."""
        at = checked_place(position_m, radius_m)
        found: list[MapObject] = []
        for key in self.keys_around(at[:2], radius_m):
            tile = self._tile(key)
            chosen = np.linalg.norm(tile.positions[:, : len(at)] - at, axis=1) <= radius_m
            found += self._named(key, tile, chosen)
        return tuple(sorted(found, key=lambda thing: thing.id))

    def along(self, positions_m: Floats, radius_m: float) -> Map:
        """The part around a path (n, 3): objects whose centres are within `radius_m` of it."""
        found: dict[int, MapObject] = {}
        last = None
        for position in positions_m:
            if last is None or np.linalg.norm(position - last) > _STEP_SHARE * radius_m:
                last = position
                found |= {thing.id: thing for thing in self.near(position, (1 + _STEP_SHARE) * radius_m)}
        path = np.asarray(positions_m, float).reshape(-1, 3)
        return Map(tuple(t for t in found.values() if _distance(t, path) <= radius_m))

    @property
    def digest(self) -> str:
        """Of everything that it holds: the same objects in the same tiles give the same, however they came there."""
        rows = "\n".join(f"{e.key} {e.table_digest} {e.meshes_digest}" for _, e in sorted(self.index.entries.items()))
        return digest_of((self.index.tile_m, self.index.categories, rows))

    def keys_around(self, position_m: Floats, radius_m: float) -> list[Key]:
        """Tiles that a circle on the ground touches, in order."""
        low = np.floor((np.asarray(position_m, float) - radius_m) / self.index.tile_m)
        high = np.floor((np.asarray(position_m, float) + radius_m) / self.index.tile_m)
        if np.prod(high - low + 1) > len(self.index.entries):
            inside = (k for k in self.index.entries if (low <= k).all() and (k <= high).all())
            return sorted(inside)
        columns, rows = (range(int(a), int(b) + 1) for a, b in zip(low, high, strict=True))
        return [(i, j) for i in columns for j in rows if (i, j) in self.index.entries]

    def tile(self, key: Key) -> tuple[MapObject, ...]:
        """All objects of a tile, by ascending id; none where there is no tile."""
        return self._named(key, self._tile(key), None) if key in self.index.entries else ()

    def tiles(self) -> Iterator[tuple[MapObject, ...]]:
        """The objects of one tile after the other."""
        for key in sorted(self.index.entries):
            yield self.tile(key)

    def table(self, key: Key) -> Tile:
        """A tile's objects without their meshes."""
        return self._read(self.index.entries[key], with_meshes=False)

    def positions(self) -> tuple[Ints, Floats]:
        """Ids (N,) and centres (N, 3) of all objects, by tiles: reads every table, no mesh."""
        tables = [self.table(key) for key in sorted(self.index.entries)]
        return (
            np.concatenate([np.zeros(0, np.int64), *(tile.ids for tile in tables)]),
            np.concatenate([np.zeros((0, 3)), *(tile.positions for tile in tables)]),
        )

    def constellations(self, radius_m: float) -> ConstellationIndex:
        """The index of pairs of objects nearer than `radius_m`, to look for a place in the whole map.

        It is made where it is first asked, in the map's folder if that can be written.
        """
        return ConstellationIndex(self, radius_m)

    def loaded(self) -> Map:
        """All objects at once, as a Map."""
        return Map(tuple(thing for tile in self.tiles() for thing in tile))

    def put(self, objects: Iterable[MapObject], *, categories: Mapping[str, Category] | None = None) -> None:
        """Add objects, in place of those of the same ids, wherever these are: all of them, or none.

        Only tiles that change are written. `categories` are those beside the shipped ones, by name. MapError if
        another process writes, if two objects have one id, or if the disk does not take it.
        """
        things = list(objects)
        self._change({thing.id for thing in things}, things, dict(categories or {}))

    def remove(self, ids: Iterable[int]) -> None:
        """Take objects out; ids that it does not have are no fault."""
        self._change(set(ids), [], {})

    def check(self) -> list[str]:
        """Whatever is wrong with the files, a line each: missing, or not what the index says."""
        wrong = []
        for entry in self.index.entries.values():
            for name, digest in ((entry.table, entry.table_digest), (entry.meshes, entry.meshes_digest)):
                path = self.folder / _TILES / name
                if not path.is_file():
                    wrong.append(f"{path}: is missing")
                elif _digest(path.read_bytes()) != digest:
                    wrong.append(f"{path}: is not what {CITY} says: its content was changed")
        return wrong

    # Reading

    def _keys_with(self, number: int) -> list[Key]:
        return sorted(key for key, e in self.index.entries.items() if e.first_id <= number <= e.last_id)

    def _tile(self, key: Key) -> Tile:
        if key not in self._held:
            self._held[key] = self._read(self.index.entries[key])
            while len(self._held) > 1 and sum(map(len, self._held.values())) > _HELD_OBJECTS:
                self._held.popitem(last=False)
        self._held.move_to_end(key)
        return self._held[key]

    def _read(self, entry: TileEntry, *, with_meshes: bool = True) -> Tile:
        contents = []
        for name in (entry.table, entry.meshes) if with_meshes else (entry.table,):
            path = self.folder / _TILES / name
            try:
                contents.append(path.read_bytes())
            except OSError:
                changed = "the map was changed since it was opened, or a file is missing: open it again"
                raise MapError(f"{path}: cannot be read: {changed}") from None
        try:
            return Tile.from_bytes(contents[0], contents[1] if with_meshes else None, self._models_of_all())
        except MapError as error:
            raise MapError(f"{self.folder / _TILES / entry.table}: {error}") from None

    def _named(self, key: Key, tile: Tile, chosen: Any) -> tuple[MapObject, ...]:  # noqa: ANN401 # a mask, or None
        try:
            return tile.objects(chosen)
        except MapError as error:
            raise MapError(f"{self.folder / _TILES / self.index.entries[key].table}: {error}") from None

    def _models_of_all(self) -> dict[str, Category]:
        for name, file in self.index.categories.items():
            if name not in self._models:
                try:
                    self._models[name] = load_category(self.folder / _CATEGORIES / file)
                except CategoryError as error:
                    raise MapError(str(error)) from None
        return self._models

    # Writing

    def _change(self, ids: set[int], things: list[MapObject], categories: dict[str, Category]) -> None:
        if len({thing.id for thing in things}) < len(things):
            raise MapError("a map's objects have different ids, some of the given ones are the same")
        with locked(self.folder / LOCK, str(self.folder)):
            self._refuse_if_changed()
            self._forget_old_files()
            before = replace(self.index, entries=dict(self.index.entries), categories=dict(self.index.categories))
            try:
                self._add_categories({thing.category for thing in things}, categories)
                for key, found in self._changed_tiles(ids, things).items():
                    self._write_tile(key, found)
                self.index.generation += 1
                write_atomically(self.folder / CITY, self.index.to_bytes())
            except BaseException:
                self.index = before
                raise
            finally:
                self._held.clear()

    def _changed_tiles(self, ids: set[int], things: list[MapObject]) -> dict[Key, list[MapObject]]:
        """What tiles hold once `ids` have gone and `things` have come, of those tiles alone that change."""
        changed: dict[Key, dict[int, MapObject]] = {}
        for key in self._keys_with_any(ids):
            kept = {thing.id: thing for thing in self.tile(key)}
            if kept.keys() & ids:
                changed[key] = {number: thing for number, thing in kept.items() if number not in ids}
        for thing in things:
            key = self._key_of(thing)
            if key not in changed:
                changed[key] = {other.id: other for other in self.tile(key)}
            changed[key][thing.id] = thing
        return {key: list(found.values()) for key, found in changed.items()}

    def _key_of(self, thing: MapObject) -> Key:
        column, row = np.floor(thing.recentred().world_from_object.translation[:2] / self.index.tile_m)
        return int(column), int(row)

    def _keys_with_any(self, ids: set[int]) -> list[Key]:
        numbers = np.array(sorted(ids), np.int64)
        return [
            key
            for key, e in sorted(self.index.entries.items())
            if np.searchsorted(numbers, e.first_id) < np.searchsorted(numbers, e.last_id, side="right")
        ]

    def _write_tile(self, key: Key, things: list[MapObject]) -> None:
        if not things:
            self.index.entries.pop(key, None)
            return
        table, meshes = Tile.of(things, self._models_of_all()).to_bytes()
        ids = [thing.id for thing in things]
        size = len(table) + len(meshes)
        entry = TileEntry(*key, len(ids), min(ids), max(ids), size, _digest(table), _digest(meshes))
        files = {self.folder / _TILES / name: data for name, data in ((entry.table, table), (entry.meshes, meshes))}
        write_together(files, self.folder / _TILES / entry.table)
        self.index.entries[key] = entry

    def _add_categories(self, names: set[str], given: Mapping[str, Category]) -> None:
        """Keep the shape spaces that meshes are written by, so that another version reads them the same."""
        for name in sorted(names - self.index.categories.keys()):
            model = given.get(name) or (load_category(name) if name in category_names() else None)
            if model is not None:
                content = category_bytes(model)
                file = f"{_UNSAFE.sub('_', name)}-{_digest(content)[:12]}.npz"
                write_atomically(self.folder / _CATEGORIES / file, content)
                self.index.categories[name] = file

    def _refuse_if_changed(self) -> None:
        if read_index(self.folder / CITY).generation != self.index.generation:
            raise MapError(f"{self.folder}: was written to by another process since it was opened: open it again")

    def _forget_old_files(self) -> None:
        """Remove files that the index does not name: of the state before this one, or of a writer that was killed."""
        remove_leftovers(self.folder)
        named = {name for entry in self.index.entries.values() for name in (entry.table, entry.meshes)}
        for path in (self.folder / _TILES).glob("*.npz"):
            if path.name not in named:
                path.unlink(missing_ok=True)


def _distance(thing: MapObject, path: Floats) -> float:
    return float(np.linalg.norm(path - thing.world_from_object.translation, axis=1).min())


def _digest(content: bytes) -> str:
    return hashlib.blake2b(content, digest_size=16).hexdigest()
