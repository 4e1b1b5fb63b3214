"""The convex hull of points in space."""

from __future__ import annotations

import numpy as np

from meshslam.geometry.arrays import AnyArray, Bools, Floats, Ints

_BULGE = 1e-7  # of the largest extent: points inside a facet move under it, so that corners alone remain
_OUTSIDE = 1e-12  # of the largest extent, cubed


def convex_hull(points: Floats) -> Ints | None:
    """Triangles (F, 3) of the hull of points (n, 3), turned outwards; None if the points lie in a plane.

    Points are added from the farthest on (quickhull: Barber, Dobkin and Huhdanpaa 1996). Points that lie in a facet or
    on an edge are left out.

    >>> cube = np.array([[x, y, z] for x in (0, 1, 2) for y in (0, 1, 2) for z in (0, 1, 2)], float)
    >>> faces = convex_hull(cube)
    >>> len(faces), len(np.unique(faces))
    (12, 8)
    """
    extent = float(np.ptp(points, axis=0).max()) if len(points) > 3 else 0.0
    if not extent > 0:
        return None
    bulged = (points - points.mean(axis=0)) / extent
    bulged = bulged * (1 + _BULGE * (bulged**2).sum(axis=1, keepdims=True))
    faces = _tetrahedron(bulged)
    if faces is None:
        return None
    left = np.arange(len(points))
    heights = _heights(bulged, faces)
    while True:
        keep = (heights > _OUTSIDE).any(axis=1)
        left, heights = left[keep], heights[keep]
        if not len(left):
            return faces
        at = int(heights.max(axis=1).argmax())
        seen = heights[at] > _OUTSIDE
        added = _cone(faces[seen], int(left[at]))
        faces = np.concatenate([faces[~seen], added])
        heights = np.concatenate([heights[:, ~seen], _heights(bulged[left], added, bulged)], axis=1)


def _heights(points: Floats, faces: Ints, corners: Floats | None = None) -> Floats:
    """Six times the volume (n, F) between points and faces: positive where a point sees the face's outer side."""
    a, b, c = (points if corners is None else corners)[faces.T]
    normals = np.cross(b - a, c - a)
    found: Floats = points @ normals.T - (a * normals).sum(axis=1)
    return found


def _tetrahedron(points: Floats) -> Ints | None:
    """Four points far apart, as faces turned outwards; None if all lie in a plane."""
    first = int(points[:, 0].argmin())
    away = np.linalg.norm(points - points[first], axis=1)
    second = int(away.argmax())
    across = np.linalg.norm(np.cross(points - points[first], points[second] - points[first]), axis=1)
    third = int(across.argmax())
    height = _heights(points, np.array([[first, second, third]]))[:, 0]
    fourth = int(np.abs(height).argmax())
    if abs(height[fourth]) < 1e-9:
        return None
    if height[fourth] > 0:
        second, third = third, second
    return np.array([[first, second, third], [first, fourth, second], [second, fourth, third], [third, fourth, first]])


def _cone(seen: Ints, tip: int) -> Ints:
    """Faces from a point to the border of the faces that it sees."""
    edges = np.concatenate([seen[:, [0, 1]], seen[:, [1, 2]], seen[:, [2, 0]]])
    border = edges[~_has_twin(edges)]
    return np.column_stack([border, np.full(len(border), tip)])


def _has_twin(edges: AnyArray) -> Bools:
    """Whether each directed edge (n, 2) is also there the other way round."""
    size = int(edges.max()) + 1
    return np.isin(edges[:, 0] * size + edges[:, 1], edges[:, 1] * size + edges[:, 0])
