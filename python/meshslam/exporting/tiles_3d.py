"""OGC 3D Tiles 1.1: a tree of boxes, with a binary glTF in each of its leaves."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.exporting.geojson import GeoOrigin
from meshslam.geometry import Floats, Pose
from meshslam.maps import TILE_M, Map, MapObject, to_glb

_CONTENT = "tiles"
_LEAF_ERROR_M = 0.0  # a leaf has all that there is
_ERROR_SHARE = 0.5  # of a box's diagonal: what leaving out its cars costs
Key = tuple[int, int]


@dataclass(frozen=True, eq=False)
class _Node:
    """A box (2, 3) in the world, metres, with what lies in it."""

    low_high: Floats
    content: dict[str, Any]


def write(run: FinishedRun, target: Path, origin: GeoOrigin | None = None) -> Notes:
    """`tileset.json` and `tiles/X_Y.glb`: objects with their properties as extras; z is up, metres.

    Each glTF is about its own tile's middle, so that single precision holds anywhere. With `origin` the tileset stands
    on the earth (EPSG:4978), without it about the world's origin.
    """
    (target / _CONTENT).mkdir(parents=True)
    keys, objects_of = _tiles_of(run)
    leaves = {key: _leaf(target, key, objects_of(key)) for key in keys}
    root = _tree(leaves) if leaves else {"boundingVolume": _box(np.zeros((2, 3))), "geometricError": 0.0}
    root["refine"] = "ADD"
    if origin is not None:
        root["transform"] = _column_major(origin.earth_from_world)
    document = {"asset": {"version": "1.1"}, "geometricError": root["geometricError"], "root": root}
    (target / "tileset.json").write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")
    return (
        () if origin is not None else ("3dtiles: about the world's own origin: --origin LAT,LON puts it on the earth",)
    )


def _tiles_of(run: FinishedRun) -> tuple[list[Key], Callable[[Key], Sequence[MapObject]]]:
    """The tiles that there are, and what each holds."""
    if run.tiled is not None:
        return sorted(run.tiled.index.entries), run.tiled.tile
    found: dict[Key, list[MapObject]] = {}
    for thing in run.scene.objects:
        column, row = np.floor(thing.world_from_object.translation[:2] / TILE_M)
        found.setdefault((int(column), int(row)), []).append(thing)
    return sorted(found), found.__getitem__


def _leaf(target: Path, key: Key, objects: Sequence[MapObject]) -> _Node:
    """Write a tile's glTF."""
    points = np.concatenate([thing.vertices_in_world for thing in objects])
    low_high = np.stack([points.min(axis=0), points.max(axis=0)])
    middle = np.round(low_high.mean(axis=0))
    shift = Pose(np.eye(3), -middle)
    about = Map(tuple(replace(t, world_from_object=shift @ t.world_from_object) for t in objects))
    name = f"{_CONTENT}/{key[0]}_{key[1]}.glb"
    (target / name).write_bytes(to_glb(about))
    return _Node(
        low_high,
        {
            "boundingVolume": _box(low_high - middle),
            "geometricError": _LEAF_ERROR_M,
            "transform": _column_major(Pose(np.eye(3), middle).matrix),
            "content": {"uri": name},
        },
    )


def _tree(leaves: Mapping[Key, _Node]) -> dict[str, Any]:
    """The node above some leaves: quarters of the grid, and quarters of these, down to single tiles."""
    if len(leaves) == 1:
        (leaf,) = leaves.values()
        return _above(leaf.low_high, [leaf.content])
    level: dict[Key, _Node] = dict(leaves)
    while len(level) > 1:
        level = {key: _joined(nodes) for key, nodes in _quartered(level)}
    (root,) = level.values()
    return root.content


def _quartered(level: Mapping[Key, _Node]) -> Iterator[tuple[Key, list[_Node]]]:
    """The nodes of each two by two neighbours, counted from the least column and row."""
    column, row = (min(key[axis] for key in level) for axis in (0, 1))
    groups: dict[Key, list[_Node]] = {}
    for key in sorted(level):
        groups.setdefault(((key[0] - column) // 2, (key[1] - row) // 2), []).append(level[key])
    yield from groups.items()


def _joined(nodes: Sequence[_Node]) -> _Node:
    if len(nodes) == 1:
        return nodes[0]
    corners = np.concatenate([node.low_high for node in nodes])
    low_high = np.stack([corners.min(axis=0), corners.max(axis=0)])
    return _Node(low_high, _above(low_high, [node.content for node in nodes]))


def _above(low_high: Floats, children: list[dict[str, Any]]) -> dict[str, Any]:
    error = _ERROR_SHARE * float(np.linalg.norm(low_high[1] - low_high[0]))
    return {"boundingVolume": _box(low_high), "geometricError": error, "children": children}


def _box(low_high: Floats) -> dict[str, list[float]]:
    """The middle, and the half axes along x, y and z."""
    half = (low_high[1] - low_high[0]) / 2
    return {"box": [*low_high.mean(axis=0).tolist(), *np.diag(half).ravel().tolist()]}


def _column_major(matrix: Floats) -> list[float]:
    values: list[float] = (np.asarray(matrix, float).T.ravel() + 0.0).tolist()
    return values
