"""An index on disk over the constellations of a map in tiles: pairs of objects by their distance, in shards.

A shard is a square of tiles. It holds its objects and a margin as seen from above, and all pairs of objects that stand
near each other, sorted by distance. A search reads the few pairs of the distance that it asks for. Shards are made
when they are first asked for, and again where their tiles have changed.
"""

from __future__ import annotations

import bisect
import hashlib
import io
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshslam.files import write_atomically
from meshslam.geometry import Floats, Ints
from meshslam.maps.constellation import Constellation
from meshslam.maps.neighbours import GroundGrid

if TYPE_CHECKING:
    from meshslam.maps.tile_index import Key
    from meshslam.maps.tiled_map import TiledMap

FOLDER = "constellations"
_FORMAT = "meshslam-constellations-1"
_SHARD_TILES = 16  # along each axis
_KEPT = 8  # shards in memory
_NEAREST_M = 2.0  # objects nearer than this tell no direction
_CARS = np.dtype([("id", "<i8"), ("place", "<f8", 3), ("yaw", "<f4"), ("size", "<f4", 3), ("sigma", "<f4")])
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Shard:
    """Objects of some tiles and of a margin, and the pairs of them, by distance."""

    cars: Any  # (n,) of _CARS
    pairs: Any  # (m, 2), int32, perhaps on disk: rows of `cars`, the first in the shard, the second anywhere

    @property
    def constellation(self) -> Constellation:
        """The objects seen from above."""
        cars = self.cars
        return Constellation(
            np.asarray(cars["place"], float),
            np.asarray(cars["yaw"], float),
            np.asarray(cars["size"], float),
            np.asarray(cars["sigma"], float),
        )

    def pairs_between(self, low_m: float, high_m: float) -> Any:  # noqa: ANN401 # (k, 2), int32
        """Those pairs whose distance is in a range."""
        rows = range(len(self.pairs))
        first = bisect.bisect_left(rows, low_m, key=self._distance_m)
        return self.pairs[first : bisect.bisect_right(rows, high_m, key=self._distance_m)]

    def _distance_m(self, row: int) -> float:
        i, j = self.pairs[row].tolist()
        one, other = self.cars["place"][i].tolist(), self.cars["place"][j].tolist()
        return math.hypot(one[0] - other[0], one[1] - other[1])


class ConstellationIndex:
    """The shards of a map in tiles.

    Files lie in the map's folder, named by what they were made of; where they cannot be written, all is kept in memory.
    """

    def __init__(self, city: TiledMap, radius_m: float) -> None:
        """`radius_m`: objects that are nearer to each other make a pair."""
        self._city, self.radius_m, self._count = city, radius_m, len(city)
        self.generation = city.index.generation  # of the map that it was made of
        self._folder = city.folder / FOLDER
        self._shards: dict[Key, Shard] = {}
        self._in_memory: dict[Key, Shard] = {}
        self._tiles_of: dict[Key, list[Key]] = {}
        for key in sorted(city.index.entries):
            self._tiles_of.setdefault((key[0] // _SHARD_TILES, key[1] // _SHARD_TILES), []).append(key)

    def __len__(self) -> int:
        return self._count

    def shards(self, progress: Progress | None = None) -> Iterator[Shard]:
        """All of them, one after the other; those that are not there yet are made and kept."""
        for done, key in enumerate(self._tiles_of):
            yield self._shard(key)
            if progress is not None:
                progress("place", done + 1, len(self._tiles_of))

    def around(self, place_m: Floats, radius_m: float) -> tuple[Ints, Constellation]:
        """Ids (n,) and constellation of the objects within a radius of a place (2,), by ascending id."""
        width_m = _SHARD_TILES * self._city.index.tile_m
        low, high = (np.floor((place_m + step) / width_m).astype(int) for step in (-radius_m, radius_m))
        keys = [(i, j) for i in range(low[0], high[0] + 1) for j in range(low[1], high[1] + 1)]
        found = [self._shard(key).cars for key in keys if key in self._tiles_of]
        cars = np.concatenate([np.zeros(0, _CARS), *found])
        cars = cars[np.linalg.norm(cars["place"][:, :2] - place_m, axis=1) <= radius_m]
        ids, rows = np.unique(cars["id"], return_index=True)
        return ids.astype(np.int64), Shard(cars[rows], None).constellation

    def _shard(self, key: Key) -> Shard:
        if key not in self._shards:
            self._shards[key] = self._in_memory.get(key) or self._read(key) or self._made(key)
            while len(self._shards) > _KEPT:
                del self._shards[next(iter(self._shards))]
        return self._shards[key]

    def _read(self, key: Key) -> Shard | None:
        try:
            cars = np.load(self._file(key, "cars"), allow_pickle=False)
            pairs = np.load(self._file(key, "pairs"), mmap_mode="r", allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        return Shard(cars, pairs) if _is_sound(cars, pairs) else None

    def _made(self, key: Key) -> Shard:
        own = self._cars(self._tiles_of[key])
        margin = self._cars(self._margin(key))
        cars = np.concatenate([own, margin])
        shard = Shard(cars, _pairs(cars, len(own), self.radius_m))
        try:
            self._folder.mkdir(exist_ok=True)
            for name, array in (("cars", shard.cars), ("pairs", shard.pairs)):
                file = self._file(key, name)
                for old in self._folder.glob(f"{key[0]}_{key[1]}.*.{name}.npy"):
                    old.unlink(missing_ok=True)
                write_atomically(file, _npy(array))
        except OSError:
            self._in_memory[key] = shard
        return shard

    def _cars(self, tiles: list[Key]) -> Any:  # noqa: ANN401 # (n,) of _CARS
        parts = [np.zeros(0, _CARS)]
        for key in tiles:
            tile = self._city.table(key)
            part, seen = np.zeros(len(tile), _CARS), tile.constellation
            part["id"], part["place"], part["yaw"] = tile.ids, seen.places, seen.yaws_rad
            part["size"], part["sigma"] = seen.sizes, seen.sigmas_m
            parts.append(part)
        return np.concatenate(parts)

    def _margin(self, key: Key) -> list[Key]:
        """Tiles about the shard that a pair may reach into."""
        reach = int(np.ceil(self.radius_m / self._city.index.tile_m))
        low = [k * _SHARD_TILES - reach for k in key]
        high = [(k + 1) * _SHARD_TILES + reach for k in key]
        about = [(i, j) for i in range(low[0], high[0]) for j in range(low[1], high[1])]
        own = set(self._tiles_of[key])
        return [tile for tile in about if tile in self._city.index.entries and tile not in own]

    def _file(self, key: Key, name: str) -> Path:
        entries = self._city.index.entries
        said = [_FORMAT, repr(self.radius_m), repr(self._city.index.tile_m)]
        said += [f"{t} {entries[t].table_digest}" for t in (*self._tiles_of[key], *self._margin(key))]
        digest = hashlib.blake2b("\n".join(said).encode(), digest_size=6).hexdigest()
        return self._folder / f"{key[0]}_{key[1]}.{digest}.{name}.npy"


def _is_sound(cars: Any, pairs: Any) -> bool:  # noqa: ANN401 # what files hold
    """Whether files hold a shard: the right columns, finite values, pairs of cars that there are."""
    if cars.dtype != _CARS or cars.ndim != 1 or pairs.dtype != np.int32 or pairs.shape[1:] != (2,):
        return False
    finite = all(np.isfinite(cars[name]).all() for name in ("place", "yaw", "size", "sigma"))
    within = not len(pairs) or (pairs.min() >= 0 and pairs.max() < len(cars))
    return bool(finite and within and (cars["size"] > 0).all())


def _pairs(cars: Any, own: int, radius_m: float) -> Any:  # noqa: ANN401 # arrays of records
    """Pairs by distance, each once in the whole map: in the shard of the object of the lesser id."""
    flat = cars["place"][:, :2]
    first, second = GroundGrid.of(flat, radius_m).near(flat[:own])
    distance = np.linalg.norm(flat[first] - flat[second], axis=1)
    kept = (cars["id"][first] < cars["id"][second]) & (distance > _NEAREST_M)
    first, second, distance = first[kept], second[kept], distance[kept]
    order = np.lexsort((second, first, distance))
    return np.column_stack([first, second])[order].astype(np.int32)


def _npy(array: Any) -> bytes:  # noqa: ANN401 # an array of records
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array, allow_pickle=False)
    return buffer.getvalue()
