"""Coordinate frames of a bag: which way leads from one to another, and how it changes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from meshslam.geometry import Floats, Pose, rotations_of_quaternions
from meshslam.sequences.bags.index import BagIndex, Edge
from meshslam.sequences.interpolation import interpolate_poses

_FIXED_M, _FIXED = 1e-4, 1e-4  # by which a mounting's translation (m) and rotation may vary


def poses_of(rows: Floats) -> tuple[Pose, ...]:
    """Poses of rows x y z qx qy qz qw (n, 7)."""
    rotations = rotations_of_quaternions(rows[:, 3:])
    return tuple(Pose(r, t) for r, t in zip(rotations, rows[:, :3], strict=True))


def fixed_transform(index: BagIndex, target: str, source: str) -> Pose | None:
    """target_from_source where nothing moves between the two frames; None where there is no such way."""
    if target == source:
        return Pose.identity()
    up, down = _way_up(index, target), _way_up(index, source)
    common = next((frame for frame in down if frame in up), None)
    if common is None:
        return None
    common_from_target, common_from_source = _fixed(index, up, common), _fixed(index, down, common)
    if common_from_target is None or common_from_source is None:
        return None
    return common_from_target.inverse() @ common_from_source


def moving_root(index: BagIndex, frame: str) -> str | None:
    """The topmost frame above this one, if something moves on the way to it."""
    way = _way_up(index, frame)
    moves = any(_fixed_edge(index.edges[pair]) is None for pair in _pairs(way))
    return way[-1] if moves else None


def moving_poses(index: BagIndex, frame: str) -> tuple[Floats, tuple[Pose, ...]]:
    """root_from_frame at the times (n,), nanoseconds, at which the way to the topmost frame changes."""
    way = _way_up(index, frame)
    edges = [index.edges[pair] for pair in _pairs(way)]
    moving = [edge for edge in edges if _fixed_edge(edge) is None]
    finest = max(moving, key=lambda edge: len(edge.rows))
    begins = max(min(edge.times_ns) for edge in moving)
    ends = min(max(edge.times_ns) for edge in moving)
    times_ns = np.array([t for t in sorted(set(finest.times_ns)) if begins <= t <= ends], float)
    found = [Pose.identity()] * len(times_ns)
    for edge in edges:
        found = [parent @ pose for parent, pose in zip(_at(edge, times_ns), found, strict=True)]
    return times_ns, tuple(found)


def _way_up(index: BagIndex, frame: str) -> list[str]:
    """The frame, its parent, and so on to the topmost."""
    parents = {child: parent for parent, child in index.edges}
    way = [frame]
    while (parent := parents.get(way[-1])) is not None and parent not in way:
        way.append(parent)
    return way


def _pairs(way: list[str]) -> list[tuple[str, str]]:
    """Parent and child of each step."""
    return [(parent, child) for child, parent in pairwise(way)]


def _fixed(index: BagIndex, way: list[str], top: str) -> Pose | None:
    found = Pose.identity()
    for child, parent in pairwise(way[: way.index(top) + 1]):
        step = _fixed_edge(index.edges[parent, child])
        if step is None:
            return None
        found = step @ found
    return found


def _fixed_edge(edge: Edge) -> Pose | None:
    """The edge's one transform; None where it changes."""
    table = edge.rows
    signs = np.sign((table[:, 3:] * table[0, 3:]).sum(axis=1, keepdims=True))
    moved = np.abs(table[:, :3] - table[0, :3]).max() > _FIXED_M
    turned = np.abs(table[:, 3:] * signs - table[0, 3:]).max() > _FIXED
    return None if moved or turned else poses_of(table[:1])[0]


def _at(edge: Edge, times_ns: Floats) -> tuple[Pose, ...]:
    fixed = _fixed_edge(edge)
    if fixed is not None:
        return (fixed,) * len(times_ns)
    own_ns, first = np.unique(np.array(edge.times_ns, float), return_index=True)
    return interpolate_poses(own_ns, poses_of(edge.rows[first]), times_ns)
