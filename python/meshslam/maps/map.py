"""The map of objects, and its files: map.json and one PLY an object."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from meshslam.errors import GeometryError, MapError
from meshslam.files import Content, map_file, must_exist, real_path, remove_leftovers, write_together
from meshslam.geometry import AnyArray, Floats, Pose
from meshslam.maps.manifest import MESHES, written_meshes
from meshslam.maps.moving_object import MOVING, MovingObject
from meshslam.maps.moving_path import MovingPath
from meshslam.maps.objects import MapObject
from meshslam.maps.ply import DECIMALS, PlyMesh, format_ply, read_mesh
from meshslam.sequences import LARGEST

if TYPE_CHECKING:
    from meshslam.maps.tiled_map import TiledMap

Made = TypeVar("Made")
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
        object.__setattr__(self, "moving", tuple(sorted(self.moving, key=lambda thing: thing.id)))

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
        standing = (_mesh_name(thing, meshes) for thing in self.objects)
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
        entries = [_entry(thing.recentred(), meshes) for thing in self.objects]
        document: dict[str, Any] = {"format": FORMAT, "version": VERSION, "objects": entries}
        if self.moving:
            document[MOVING] = [{**_entry(one.body.recentred(), MOVING), **one.entry()} for one in self.moving]
        text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"

        def mesh(index: int) -> bytes:
            if progress is not None:
                progress(index + 1, len(self.objects))
            return _ply_bytes(self.objects[index])

        files: dict[Path, Content] = {
            folder / _mesh_name(thing, meshes): partial(mesh, k) for k, thing in enumerate(self.objects)
        }
        for one in self.moving:
            mesh_file, table, poses = (folder / name for name in one.files)
            files |= {mesh_file: _ply_bytes(one.body), table: one.path.to_csv(), poses: one.path.to_tum()}
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
        document = _read_json(file)
        entries = document.get("objects")
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise MapError(f"{file}: objects: expected a list of objects")
        if document.get("format", FORMAT) != FORMAT or document.get("version", VERSION) != VERSION:
            found = f"{document.get('format')!r} version {document.get('version')!r}"
            raise MapError(f"{file}: format: found {found}, expected {FORMAT!r} version {VERSION}")
        objects: list[MapObject] = []
        for i, entry in enumerate(entries):
            thing = _read_entry(file, i, entry, allow_outside=allow_outside)
            objects.append(_sharing_faces(thing, objects[-1]) if objects else thing)
        moving = _read_moving(file, document, allow_outside=allow_outside)
        return _named(file, lambda: Map(tuple(objects), moving))


def _read_moving(file: Path, document: Mapping[str, Any], *, allow_outside: bool) -> tuple[MovingObject, ...]:
    """What drives; none where the document says nothing of it."""
    entries = document.get(MOVING, [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise MapError(f"{file}: {MOVING}: expected a list of objects")
    found: list[MovingObject] = []
    for i, entry in enumerate(entries):
        body, where = _read_entry(file, i, entry, allow_outside=allow_outside, key=MOVING), f"{file}: {MOVING}[{i}]"
        name, time_s = (_needed(where, entry, key) for key in ("path", "timestamp"))
        if not isinstance(name, str):
            raise MapError(f"{where}: path: expected text, found {repr(name)[:60]}")
        table = _mesh_path(file, name, where, allow_outside=allow_outside)
        found.append(MovingObject(body, float(_array(where, "timestamp", time_s)), MovingPath.load(table)))
    return tuple(found)


def _sharing_faces(thing: MapObject, other: MapObject) -> MapObject:
    """The same object; where another's faces are equal they are held once."""
    return replace(thing, faces=other.faces) if np.array_equal(thing.faces, other.faces) else thing


def checked_place(position_m: Floats, radius_m: float) -> Floats:
    """A position of two or three numbers; MapError for anything else, or a radius that is none."""
    at = np.asarray(position_m, float)
    if at.shape not in ((2,), (3,)) or not np.isfinite(at).all() or not radius_m >= 0:
        raise MapError(f"near: expected a position of 2 or 3 finite numbers and a radius, found {at}, {radius_m}")
    return at


def _named(file: Path, make: Callable[[], Made]) -> Made:
    """Make something, and name the file if that fails."""
    try:
        return make()
    except MapError as error:
        raise MapError(f"{file}: {error}") from None


def _mesh_name(thing: MapObject, meshes: str) -> str:
    return f"{meshes}/{thing.id}.ply"


def _ply_bytes(thing: MapObject) -> bytes:
    centred = thing.recentred()
    return format_ply(PlyMesh(centred.vertices, centred.faces, centred.vertex_sigma_m, centred.vertex_observed))


def _entry(thing: MapObject, meshes: str) -> dict[str, Any]:
    """One object as JSON; what is not known is left out."""
    entry: dict[str, Any] = {
        "id": thing.id,
        "category": thing.category,
        "world_from_object": _numbers(thing.world_from_object.matrix),
        "dimensions": _numbers(np.ptp(np.round(thing.vertices, DECIMALS), axis=0)),
        "mesh": _mesh_name(thing, meshes),
        "views": thing.views,
        "first_frame": thing.first_frame,
        "last_frame": thing.last_frame,
        "mask_iou": None if thing.mask_iou is None else _numbers(thing.mask_iou),
        "keypoints": {name: _numbers(point) for name, point in sorted(thing.keypoints.items())},
        "pose_covariance": None if thing.pose_covariance is None else _numbers(thing.pose_covariance),
        "vertex_sigma_m": _sigma_summary(thing),
    }
    return {key: value for key, value in entry.items() if value is not None}


def _sigma_summary(thing: MapObject) -> dict[str, Any] | None:
    if thing.vertex_sigma_m is None:
        return None
    observed = np.ones(len(thing.vertices)) if thing.vertex_observed is None else thing.vertex_observed
    sigma = np.round(thing.vertex_sigma_m, DECIMALS)
    figures = {"median": np.median(sigma), "p90": np.quantile(sigma, 0.9), "observed_share": np.mean(observed)}
    return {name: _numbers(float(value)) for name, value in figures.items()}


def _numbers(values: AnyArray | float) -> Any:  # noqa: ANN401 # a number, or nested lists of them
    """Round, and give plain numbers, never -0."""
    return (np.round(np.asarray(values, float), DECIMALS) + 0.0).tolist()


def _read_json(file: Path) -> Mapping[str, Any]:
    must_exist(file, "map", MapError)
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise MapError(f"{file}: cannot be read as JSON: {error}") from None
    if not isinstance(document, dict):
        raise MapError(f"{file}: expected an object with a list of objects")
    return document


def _read_entry(
    file: Path, index: int, entry: Mapping[str, Any], *, allow_outside: bool, key: str = "objects"
) -> MapObject:
    where = f"{file}: {key}[{index}]"
    number, category, name = (_needed(where, entry, needed) for needed in ("id", "category", "mesh"))
    if (
        not isinstance(number, int)
        or isinstance(number, bool)
        or not isinstance(category, str)
        or not isinstance(name, str)
    ):
        raise MapError(f"{where}: id must be a whole number, category and mesh text")
    where = f"{file}: object {number}"
    try:
        pose = Pose.from_matrix(_array(where, "world_from_object", _needed(where, entry, "world_from_object")))
    except GeometryError as error:
        raise MapError(f"{where}: world_from_object: {error}") from None
    keypoints, covariance = entry.get("keypoints") or {}, entry.get("pose_covariance")
    if not isinstance(keypoints, dict):
        raise MapError(f"{where}: keypoints: expected names with x, y, z")
    mesh = read_mesh(_mesh_path(file, name, where, allow_outside=allow_outside))
    fields: dict[str, Any] = dict(
        id=number,
        category=category,
        world_from_object=pose,
        vertices=mesh.vertices,
        faces=mesh.faces,
        views=_whole(where, entry, "views") or 0,
        first_frame=_whole(where, entry, "first_frame"),
        last_frame=_whole(where, entry, "last_frame"),
        mask_iou=None if entry.get("mask_iou") is None else float(_array(where, "mask_iou", entry["mask_iou"])),
        keypoints={name: _array(where, f"keypoints {name}", point) for name, point in keypoints.items()},
        pose_covariance=None if covariance is None else _array(where, "pose_covariance", covariance),
        vertex_sigma_m=mesh.sigma_m,
        vertex_observed=mesh.observed,
    )
    return _named(file, lambda: MapObject(**fields)).recentred()


def _mesh_path(file: Path, name: str, where: str, *, allow_outside: bool) -> Path:
    """Where a mesh is; MapError if that is outside the map's folder, also by a link."""
    path = file.parent / name
    try:
        inside = real_path(path).is_relative_to(real_path(file.parent))
    except (OSError, ValueError, RuntimeError):  # circles of links, names that no file can have
        raise MapError(f"{where}: mesh: {name[:60]!r} is no file's name that can be read") from None
    if not inside and not allow_outside:
        raise MapError(f"{where}: mesh: {name[:60]!r} is outside the map's folder: --allow-outside reads it")
    return path


def _needed(where: str, entry: Mapping[str, Any], key: str) -> Any:  # noqa: ANN401 # as JSON has it
    if entry.get(key) is None:
        raise MapError(f"{where}: {key}: key is missing")
    return entry[key]


def _whole(where: str, entry: Mapping[str, Any], key: str) -> int | None:
    value = entry.get(key)
    if value is not None and (not isinstance(value, int) or isinstance(value, bool)):
        raise MapError(f"{where}: {key}: expected a whole number, found {repr(value)[:60]}")
    return value


def _array(where: str, key: str, value: object) -> Floats:
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError, OverflowError, RecursionError):
        raise MapError(f"{where}: {key}: expected numbers, found {repr(value)[:60]}") from None
    if not (np.abs(array) < LARGEST).all():
        raise MapError(f"{where}: {key}: expected finite numbers below {LARGEST:g}")
    return array
