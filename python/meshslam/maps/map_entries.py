"""The entries of map.json: one object of a map as JSON, and read again."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from meshslam.errors import GeometryError, MapError
from meshslam.files import must_exist, real_path
from meshslam.geometry import AnyArray, Floats, Pose
from meshslam.maps.moving_object import MOVING, MovingObject
from meshslam.maps.moving_path import MovingPath
from meshslam.maps.objects import MapObject
from meshslam.maps.ply import DECIMALS, PlyMesh, format_ply, read_mesh
from meshslam.sequences import LARGEST

Made = TypeVar("Made")


def named(file: Path, make: Callable[[], Made]) -> Made:
    """Make something, and name the file if that fails."""
    try:
        return make()
    except MapError as error:
        raise MapError(f"{file}: {error}") from None


def mesh_name(thing: MapObject, meshes: str) -> str:
    """Name of an object's mesh in a map's folder."""
    return f"{meshes}/{thing.id}.ply"


def ply_bytes(thing: MapObject) -> bytes:
    """An object's mesh as a file."""
    centred = thing.recentred()
    return format_ply(PlyMesh(centred.vertices, centred.faces, centred.vertex_sigma_m, centred.vertex_observed))


def entry_of(thing: MapObject, meshes: str) -> dict[str, Any]:
    """One object as JSON; what is not known is left out."""
    entry: dict[str, Any] = {
        "id": thing.id,
        "category": thing.category,
        "world_from_object": _numbers(thing.world_from_object.matrix),
        "dimensions": _numbers(np.ptp(np.round(thing.vertices, DECIMALS), axis=0)),
        "mesh": mesh_name(thing, meshes),
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


def read_json(file: Path) -> Mapping[str, Any]:
    """The document of a map; MapError where it is none."""
    must_exist(file, "map", MapError)
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise MapError(f"{file}: cannot be read as JSON: {error}") from None
    if not isinstance(document, dict):
        raise MapError(f"{file}: expected an object with a list of objects")
    return document


def read_entry(
    file: Path, index: int, entry: Mapping[str, Any], *, allow_outside: bool, key: str = "objects"
) -> MapObject:
    """One object as its entry has it; MapError names what is wrong."""
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
    return named(file, lambda: MapObject(**fields))


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


def read_moving(file: Path, document: Mapping[str, Any], *, allow_outside: bool) -> tuple[MovingObject, ...]:
    """What drives; none where the document says nothing of it."""
    entries = document.get(MOVING, [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise MapError(f"{file}: {MOVING}: expected a list of objects")
    found: list[MovingObject] = []
    for i, entry in enumerate(entries):
        body, where = read_entry(file, i, entry, allow_outside=allow_outside, key=MOVING), f"{file}: {MOVING}[{i}]"
        name, time_s = (_needed(where, entry, key) for key in ("path", "timestamp"))
        if not isinstance(name, str):
            raise MapError(f"{where}: path: expected text, found {repr(name)[:60]}")
        table = _mesh_path(file, name, where, allow_outside=allow_outside)
        found.append(MovingObject(body, float(_array(where, "timestamp", time_s)), MovingPath.load(table)))
    return tuple(found)
