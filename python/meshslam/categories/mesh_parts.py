"""Parts of a mesh file that are no part of the object: shadow planes, and other objects."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from meshslam.geometry import Floats, Ints

_FLAT = 0.01  # height of a shadow plane, of the mesh's largest side
_WIDE = 0.5  # of the mesh's footprint that it covers at least
_GAP = 0.1  # between two objects, of the longest side
_SIMILAR = 0.5  # size of another object, of the largest one's


def without_shadow_planes(vertices: Floats, faces: Ints, up: Floats) -> tuple[Ints, int]:
    """The faces (F, 3) without level sheets under the object, and how many sheets there were.

    A shadow plane is a connected part with no height, at the lowest point of the mesh, as large as its footprint.
    """
    labels = _parts(vertices, faces)
    height = vertices @ up
    across = vertices - np.outer(height, up)
    longest, lowest = float(np.ptp(vertices, axis=0).max()), float(height[np.unique(faces)].min())
    footprint = _area(across[np.unique(faces)])
    keep, sheets = np.ones(len(faces), bool), 0
    for label in np.unique(labels):
        used = np.unique(faces[labels == label])
        flat = float(np.ptp(height[used])) <= _FLAT * longest
        low = float(height[used].min()) - lowest <= 2 * _FLAT * longest
        if flat and low and _area(across[used]) > _WIDE * footprint:
            keep[labels == label] = False
            sheets += 1
    return (faces[keep], sheets) if keep.any() else (faces, 0)


def object_count(vertices: Floats, faces: Ints) -> int:
    """How many objects of like size stand apart from each other: parts whose boxes touch are one."""
    labels = _parts(vertices, faces)
    boxes = [vertices[np.unique(faces[labels == label])] for label in np.unique(labels)]
    low, high = np.array([box.min(0) for box in boxes]), np.array([box.max(0) for box in boxes])
    gap = _GAP * float(np.ptp(vertices, axis=0).max()) / 2
    touch = ((low[:, None] - gap <= high[None]) & (low[None] - gap <= high[:, None])).all(2)
    count, group = connected_components(coo_matrix(np.asarray(touch, np.int8)), directed=False)
    sizes = np.array([np.ptp(np.r_[low[group == g], high[group == g]], axis=0).max() for g in range(count)])
    return int((sizes >= _SIMILAR * sizes.max()).sum())


def _parts(vertices: Floats, faces: Ints) -> Ints:
    """A label for each face: of the part that shares corners, by place."""
    _, place = np.unique(np.round(vertices / max(1e-12, float(np.abs(vertices).max())), 7), axis=0, return_inverse=True)
    joined = place.reshape(-1)[faces]
    rows, columns = np.r_[joined[:, 0], joined[:, 1]], np.r_[joined[:, 1], joined[:, 2]]
    size = int(joined.max()) + 1
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)[joined[:, 0]]


def _area(points: Floats) -> float:
    """Of the two largest sides of a bounding box."""
    sides = np.sort(np.ptp(points, axis=0))
    return float(sides[-1] * sides[-2])
