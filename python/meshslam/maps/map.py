"""The map of objects, and its files: map.json and one PLY an object."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshslam.errors import MapError
from meshslam.files import Content, map_file, remove_leftovers, write_together
from meshslam.geometry import Floats
from meshslam.maps.manifest import MESHES, written_meshes
from meshslam.maps.map_entries import entry_of, mesh_name, named, ply_bytes, read_entry, read_json, read_moving
from meshslam.maps.moving_object import MOVING, MovingObject
from meshslam.maps.objects import MapObject

if TYPE_CHECKING:
    from meshslam.maps.tiled_map import TiledMap

FORMAT, VERSION = "meshslam-map", 1


@dataclass(frozen=True, eq=False)
class Map(Mapping[int, MapObject]):
    """Objects in one world, by their ids, in ascending order: a mapping of id to MapObject.

    The mapping holds what stands. What drives is in `moving`, apart from it: nothing is localized in those, and no
    loop is closed by them.

    MapError for two objects of one id; KeyError, naming the ids that there are, for an id that is not in the map.

    Example:
        scene = meshslam.Map.load("run")
        scene[3].vertices_in_world  # (V, 3), metres
        [number for number, thing in scene.items() if thing.category == "car"]

    """

    objects: tuple[MapObject, ...]
    moving: tuple[MovingObject, ...] = ()

    def __post_init__(self) -> None:
        ids = [thing.id for thing in self.objects] + [thing.id for thing in self.moving]
        if len(set(ids)) < len(ids):
            raise MapError(f"a map's objects have different ids, found {sorted(ids)}")
        object.__setattr__(self, "objects", tuple(sorted(self.objects, key=lambda thing: thing.id)))
        moving = (thing.recentred() for thing in self.moving)
        object.__setattr__(self, "moving", tuple(sorted(moving, key=lambda thing: thing.id)))

    def __len__(self) -> int:
        return len(self.objects)

    def __iter__(self) -> Iterator[int]:
        return (thing.id for thing in self.objects)

    def __getitem__(self, number: int) -> MapObject:
        if number not in self._by_id:
            raise KeyError(f"the map has no object {number}, it has {sorted(self) or 'none'}")
        return self._by_id[number]

    def __contains__(self, number: object) -> bool:
        return number in self._by_id

    @cached_property
    def _by_id(self) -> dict[object, MapObject]:
        return {thing.id: thing for thing in self.objects}

    @property
    def mesh_files(self) -> tuple[str, ...]:
        """Names of the meshes, and of the paths of what drives, that `save` writes, in its folder."""
        return self.mesh_files_in(MESHES)

    def mesh_files_in(self, meshes: str) -> tuple[str, ...]:
        """The same where `save` is told another folder for them."""
        standing = (mesh_name(thing, meshes) for thing in self.objects)
        return (*standing, *(name for thing in self.moving for name in thing.files))

    def save(
        self, folder: Path | str, *, meshes: str = MESHES, progress: Callable[[int, int], None] | None = None
    ) -> None:
        """Write objects/<id>.ply, moving/<id>.ply and paths and, last, map.json: the same map gives the same bytes.

        Meshes that the map.json before it named go with it, other files stay. MapError if the disk does not take it;
        what was there before then stays. `meshes`, objects or objects-2, is the folder of the meshes: where a map is
        saved again and again, the one that the map before does not use leaves that map whole until this one is.
        `progress` is told how many meshes are on the disk, of how many.
        """
        folder = Path(folder)
        try:
            for name in (meshes, *([MOVING] if self.moving else [])):
                (folder / name).mkdir(parents=True, exist_ok=True)
                remove_leftovers(folder / name)
        except OSError as error:
            raise MapError(f"{error.filename or folder / meshes}: cannot be made: {error.strerror}") from None
        before = written_meshes(folder)
        entries = [entry_of(thing.recentred(), meshes) for thing in self.objects]
        document: dict[str, Any] = {"format": FORMAT, "version": VERSION, "objects": entries}
        if self.moving:
            document[MOVING] = [{**entry_of(one.body, MOVING), **one.entry()} for one in self.moving]
        text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"

        def mesh(index: int) -> bytes:
            if progress is not None:
                progress(index + 1, len(self.objects))
            return ply_bytes(self.objects[index])

        files: dict[Path, Content] = {
            folder / mesh_name(thing, meshes): partial(mesh, k) for k, thing in enumerate(self.objects)
        }
        for one in self.moving:
            mesh_file, table, poses = (folder / name for name in one.files)
            files |= {mesh_file: ply_bytes(one.body), table: one.path.to_csv(), poses: one.path.to_tum()}
        write_together({**files, folder / "map.json": text.encode()}, folder / "map.json")
        for name in before:
            if folder / name not in files:
                (folder / name).unlink(missing_ok=True)

    def near(self, position_m: Floats, radius_m: float) -> tuple[MapObject, ...]:
        """Objects whose centres are within `radius_m` of a position, (2,) on the ground or (3,), by ascending id."""
        at = checked_place(position_m, radius_m)
        away = [thing.world_from_object.translation[: len(at)] - at for thing in self.objects]
        return tuple(t for t, d in zip(self.objects, away, strict=True) if np.linalg.norm(d) <= radius_m)

    @staticmethod
    def open(path: Path | str, *, allow_outside: bool = False) -> Map | TiledMap:
        """A map as it is on disk: one in tiles is read where it is asked (TiledMap), any other is loaded."""
        from meshslam.maps.tiled_map import TiledMap

        return TiledMap.open(path) if TiledMap.is_at(path) else Map.load(path, allow_outside=allow_outside)

    @staticmethod
    def load(path: Path | str, *, allow_outside: bool = False) -> Map:
        """Read a run directory, its map.json, an objects.json, or all of a map in tiles.

        MapError names the file, the object and the key.

        Meshes outside the file's folder are read with `allow_outside` only, so that a map from elsewhere opens nothing
        but its own files.
        """
        from meshslam.maps.tiled_map import TiledMap

        path = Path(path)
        if TiledMap.is_at(path):
            return TiledMap.open(path).loaded()
        file = map_file(path)
        document = read_json(file)
        entries = document.get("objects")
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise MapError(f"{file}: objects: expected a list of objects")
        if document.get("format", FORMAT) != FORMAT or document.get("version", VERSION) != VERSION:
            found = f"{document.get('format')!r} version {document.get('version')!r}"
            raise MapError(f"{file}: format: found {found}, expected {FORMAT!r} version {VERSION}")
        objects: list[MapObject] = []
        for i, entry in enumerate(entries):
            thing = read_entry(file, i, entry, allow_outside=allow_outside).recentred()
            objects.append(_sharing_faces(thing, objects[-1]) if objects else thing)
        moving = read_moving(file, document, allow_outside=allow_outside)
        return named(file, lambda: Map(tuple(objects), moving))


def _sharing_faces(thing: MapObject, other: MapObject) -> MapObject:
    """The same object; where another's faces are equal they are held once."""
    return replace(thing, faces=other.faces) if np.array_equal(thing.faces, other.faces) else thing


def checked_place(position_m: Floats, radius_m: float) -> Floats:
    """A position of two or three numbers; MapError for anything else, or a radius that is none."""
    at = np.asarray(position_m, float)
    if at.shape not in ((2,), (3,)) or not np.isfinite(at).all() or not radius_m >= 0:
        raise MapError(f"near: expected a position of 2 or 3 finite numbers and a radius, found {at}, {radius_m}")
    return at
