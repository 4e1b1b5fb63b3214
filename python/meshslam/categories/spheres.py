"""The icosphere that mirrors onto itself in the plane y = 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.errors import CategoryError
from meshslam.geometry import Floats, Ints

GOLDEN = (1 + 5**0.5) / 2


@dataclass(frozen=True, eq=False)
class Icosphere:
    """A subdivided icosahedron on the unit sphere, exactly symmetric in y -> -y."""

    vertices: Floats  # (V, 3), unit length
    faces: Ints  # (F, 3), outward
    mirror: Ints  # (V,)

    @property
    def plane(self) -> Ints:
        """Indices of the vertices of the mirror plane."""
        return np.flatnonzero(self.mirror == np.arange(len(self.mirror)))


def icosphere(subdivisions: int) -> Icosphere:
    """Build the icosphere of 10 * 4**subdivisions + 2 vertices; CategoryError below zero or above six subdivisions.

    The icosahedron's twelve vertices are the cyclic permutations of (0, ±1, ±golden ratio), for which y = 0 is a
    mirror plane through four vertices; after three subdivisions it holds 32 of 642 vertices.
    """
    if not 0 <= subdivisions <= 6:
        raise CategoryError(f"an icosphere has 0 to 6 subdivisions, found {subdivisions}")
    vertices, faces = _icosahedron()
    for _ in range(subdivisions):
        vertices, faces = subdivide(vertices, faces)
        vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    vertices, mirror = _symmetrized(vertices)
    return Icosphere(vertices, faces, mirror)


def subdivide(vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Split each face into four at its edges' midpoints; old vertices keep their places and indices."""
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, edge_of_side = np.unique(sides, axis=0, return_inverse=True)
    middle = len(vertices) + edge_of_side.reshape(-1, 3)
    (a, b, c), (ab, bc, ca) = faces.T, middle.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    split = np.stack([np.stack(part, 1) for part in parts], 1).reshape(-1, 3)
    return np.concatenate([vertices, vertices[edges].mean(1)]), split


def edges_of(faces: Ints) -> Ints:
    """The (E, 2) undirected edges of `faces`, sorted."""
    edges: Ints = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    return edges


def _icosahedron() -> tuple[Floats, Ints]:
    corners = np.array([(0.0, s, t * GOLDEN) for s in (-1, 1) for t in (-1, 1)])
    vertices = np.concatenate([np.roll(corners, shift, axis=1) for shift in range(3)])
    near = np.abs(np.linalg.norm(vertices[:, None] - vertices, axis=2) - 2) < 1e-9
    faces = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[k, i]
    ]
    outward = [f if np.linalg.det(vertices[list(f)]) > 0 else (f[0], f[2], f[1]) for f in faces]
    return vertices / np.linalg.norm(vertices[0]), np.array(outward, dtype=np.int64)


def _symmetrized(vertices: Floats) -> tuple[Floats, Ints]:
    """Find each vertex's mirror image and make the mirror exact."""
    flipped = vertices * [1.0, -1.0, 1.0]
    mirror = np.linalg.norm(flipped[:, None] - vertices, axis=2).argmin(1).astype(np.int64)
    return (vertices + flipped[mirror]) / 2, mirror
