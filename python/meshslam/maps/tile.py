"""One tile of a city map: a table of its objects, and their meshes, as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from meshslam.categories import Category
from meshslam.errors import GeometryError, MapError
from meshslam.files import arrays_from_bytes, arrays_to_bytes
from meshslam.geometry import Bools, Floats, Ints
from meshslam.maps.constellation import Constellation
from meshslam.maps.mesh_code import STEP_M, Arrays, MeshCode, packed, sigma_code, sigma_of_code, unpacked
from meshslam.maps.objects import MapObject
from meshslam.maps.tile_columns import Shape, array_of_texts, check_columns, columns_of, object_of

_MOST_BYTES = 1 << 30  # that a file may unpack to
_UPPER_OF_PLACE = [0, 1, 2, 6, 7, 11]  # of the upper triangle of (6, 6), row by row: that of (3, 3)
_OWN = "own"  # the group of meshes that follow no category


@dataclass(frozen=True, eq=False)
class Tile:
    """Objects of a tile, packed: made by `Tile.of`, unpacked by `objects`."""

    table: Arrays
    meshes: Arrays
    categories: Mapping[str, Category]

    def __len__(self) -> int:
        return len(self.table["id"])

    @staticmethod
    def of(objects: Sequence[MapObject], categories: Mapping[str, Category]) -> Tile:
        """Pack objects; meshes with a category's topology are written by its modes and a rounded residual."""
        things = sorted((_recentred(thing) for thing in objects), key=lambda thing: thing.id)
        groups = [_group_of(thing, categories) for thing in things]
        names = sorted(set(groups))
        meshes: Arrays = {}
        rows = np.zeros(len(things), np.int32)
        for name in names:
            members = [i for i, group in enumerate(groups) if group == name]
            rows[members] = np.arange(len(members))
            chosen = [things[i] for i in members]
            found = _own_meshes(chosen) if name == _OWN else _coded_meshes(chosen, name, categories)
            meshes |= {f"{name}.{key}": array for key, array in found.items()}
        group = np.array([names.index(name) for name in groups], np.int16)
        table = {"groups": array_of_texts(names), "group": group, "row": rows, **columns_of(things, categories)}
        return Tile(table, meshes, categories)

    @staticmethod
    def from_bytes(table: bytes, meshes: bytes | None, categories: Mapping[str, Category]) -> Tile:
        """The reverse of `to_bytes`, of the table alone where ids and places suffice; MapError if it is damaged."""
        try:
            shapes = {} if meshes is None else arrays_from_bytes(meshes, _MOST_BYTES)
            columns = arrays_from_bytes(table, _MOST_BYTES)
            check_columns(columns)
            return Tile(columns, shapes, categories)
        except ValueError as error:
            raise MapError(str(error)) from None

    def to_bytes(self) -> tuple[bytes, bytes]:
        """The table and the meshes as two .npz files: the same objects give the same bytes."""
        return arrays_to_bytes(self.table), arrays_to_bytes(self.meshes)

    @cached_property
    def ids(self) -> Ints:
        """Ids (N,), ascending."""
        return np.asarray(self.table["id"], np.int64)

    @cached_property
    def positions(self) -> Floats:
        """Centres (N, 3) of the objects, in world, metres."""
        return np.asarray(self.table["position"], float)

    @cached_property
    def constellation(self) -> Constellation:
        """The objects seen from above, by the table alone."""
        upper, turn = np.asarray(self.table["covariance"], float), np.asarray(self.table["rotation"], float)
        covariance = np.zeros((len(self), 3, 3))
        covariance[:, *np.triu_indices(3)] = upper[:, _UPPER_OF_PLACE]
        covariance += np.triu(covariance, 1).transpose(0, 2, 1)
        in_world = turn @ covariance @ turn.transpose(0, 2, 1)
        variance = np.nan_to_num((in_world[:, 0, 0] + in_world[:, 1, 1]) / 2)
        yaws = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
        return Constellation(self.positions, yaws, STEP_M * self.table["size"], np.sqrt(np.maximum(variance, 0.0)))

    def objects(self, chosen: Bools | None = None) -> tuple[MapObject, ...]:
        """The objects, or those that a mask (N,) chooses, by ascending id; MapError if the arrays are damaged."""
        picked = np.arange(len(self)) if chosen is None else np.flatnonzero(chosen)
        try:
            return self._unpacked(picked)
        except (KeyError, IndexError, ValueError, TypeError, GeometryError) as error:
            raise MapError(f"damaged arrays: {type(error).__name__}: {' '.join(str(error).split())[:150]}") from None

    def _unpacked(self, picked: Ints) -> tuple[MapObject, ...]:
        names, groups = [str(name) for name in self.table["groups"]], self.table["group"][picked]
        found: dict[int, MapObject] = {}
        for number in sorted(set(groups.tolist())):
            members = picked[groups == number]
            name = names[number]
            prefix = f"{name}."
            own = {key.removeprefix(prefix): a for key, a in self.meshes.items() if key.startswith(prefix)}
            rows = self.table["row"][members]
            shapes = _own_shapes(own, rows) if name == _OWN else _coded_shapes(own, rows, name, self.categories)
            for index, shape in zip(members.tolist(), shapes, strict=True):
                found[index] = object_of(self.table, index, shape, self.categories)
        return tuple(found[index] for index in picked.tolist())


def _recentred(thing: MapObject) -> MapObject:
    """About its box's centre; one that rounding has moved by less than a step stays, or it would wander."""
    middle = (thing.vertices.max(axis=0) + thing.vertices.min(axis=0)) / 2
    return thing if np.abs(middle).max() <= STEP_M else thing.recentred()


def _group_of(thing: MapObject, categories: Mapping[str, Category]) -> str:
    """How the mesh is written: `own`, `CATEGORY/half` or `CATEGORY/full`."""
    model = categories.get(thing.category)
    if model is None or not MeshCode(model).covers(thing.vertices, thing.faces):
        return _OWN
    sigma = thing.vertex_sigma_m
    even = sigma is None or bool((np.abs(sigma - sigma[model.mirror]) <= 1e-3 * sigma).all())
    return f"{thing.category}/{'half' if even and MeshCode(model).is_symmetric(thing.vertices) else 'full'}"


def _coded_meshes(things: Sequence[MapObject], group: str, categories: Mapping[str, Category]) -> Arrays:
    category, kind = group.rsplit("/", 1)
    code, count = MeshCode(categories[category]), len(things[0].vertices)
    symmetric = kind == "half"
    sigmas = sigma_code(np.array([_or_zeros(thing.vertex_sigma_m, count) for thing in things]))
    observed = packed(np.array([_or_zeros(thing.vertex_observed, count) for thing in things], bool))
    return {
        **code.encode(np.array([thing.vertices for thing in things]), symmetric=symmetric),
        "sigma": code.encode_vertex_values(sigmas, symmetric=symmetric),
        "observed": observed,
    }


def _coded_shapes(arrays: Arrays, rows: Ints, group: str, categories: Mapping[str, Category]) -> list[Shape]:
    category, kind = group.rsplit("/", 1)
    code, symmetric = MeshCode(categories[category]), kind == "half"
    chosen = {key: arrays[key][rows] for key in ("z", "offset", "sigma", "observed")}
    chosen["residual"] = arrays["residual"][:, :, rows]
    _check_shapes(chosen, code, len(rows), symmetric=symmetric)
    meshes = code.decode(chosen, symmetric=symmetric)
    sigmas = sigma_of_code(code.decode_vertex_values(chosen["sigma"], symmetric=symmetric))
    observed, faces = unpacked(chosen["observed"], meshes.shape[1]), code.category.faces
    return [(meshes[i], faces, sigmas[i], observed[i]) for i in range(len(rows))]


def _check_shapes(arrays: Arrays, code: MeshCode, count: int, *, symmetric: bool) -> None:
    """ValueError for arrays that NumPy would stretch to others' shapes."""
    vertices = len(code.category.vertices)
    kept = len(code.half) if symmetric else vertices
    expected = {
        "z": (count, len(code.category.modes)),
        "offset": (count, 3),
        "residual": (3, kept, count),
        "sigma": (count, kept),
        "observed": (count, -(-vertices // 8)),
    }
    for name, shape in expected.items():
        if arrays[name].shape != shape:
            raise ValueError(f"{name} has shape {arrays[name].shape}, expected {shape}")


def _own_meshes(things: Sequence[MapObject]) -> Arrays:
    counts = [len(thing.vertices) for thing in things]
    sigmas = [_or_zeros(thing.vertex_sigma_m, count) for thing, count in zip(things, counts, strict=True)]
    observed = [_or_zeros(thing.vertex_observed, count) for thing, count in zip(things, counts, strict=True)]
    return {
        "vertices": np.concatenate([thing.vertices for thing in things]).astype(np.float32),
        "faces": np.concatenate([thing.faces for thing in things]).astype(np.int32),
        "vertex_end": np.cumsum(counts, dtype=np.int64),
        "face_end": np.cumsum([len(thing.faces) for thing in things], dtype=np.int64),
        "sigma": sigma_code(np.concatenate(sigmas)),
        "observed": np.concatenate(observed).astype(np.uint8),
    }


def _own_shapes(arrays: Arrays, rows: Ints) -> list[Shape]:
    def part(name: str, ends: str, row: int) -> Any:  # noqa: ANN401 # an array's slice
        end = arrays[ends]
        return arrays[name][(end[row - 1] if row else 0) : end[row]]

    return [
        (
            np.asarray(part("vertices", "vertex_end", row), float),
            np.asarray(part("faces", "face_end", row), np.int64),
            sigma_of_code(part("sigma", "vertex_end", row)),
            np.asarray(part("observed", "vertex_end", row), bool),
        )
        for row in rows.tolist()
    ]


def _or_zeros(values: Floats | Bools | None, count: int) -> Any:  # noqa: ANN401 # as given
    return np.zeros(count) if values is None else values
