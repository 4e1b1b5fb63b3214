"""Any triangle mesh, closed or open, as a solid: negative inside, metres near the surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from meshslam.errors import CategoryError
from meshslam.geometry import AnyArray, Floats, Ints

CELLS = 110  # along the longest side
CLOSED_BY = 2.0  # cells: gaps of up to twice this are closed
LEAK = 0.5  # a solid of less than this share of what the surface hides has a hole
MARGIN_CELLS = 8
LEAST_CELLS = 30  # inside, off the surface
BAND = 4.5  # cells in which distances are exact
NOTHING_INSIDE = "its surface hides no volume: it is flat, or open on most sides"


@dataclass(frozen=True, eq=False)
class MeshSolid:
    """The solid that a ball, rolled around a mesh from outside, cannot enter (morphological closing).

    Neither the faces' orientation nor inner walls, doubled faces or small gaps matter. Where the ball gets in through
    a hole, what is hidden from both sides along at least two axes is solid too.
    """

    vertices: Floats  # (V, 3) metres
    faces: Ints  # (F, 3)

    @cached_property
    def field(self) -> GridField:
        """The distance to the closed surface, negative inside; exact to half a cell, to 0.1 on average."""
        return GridField(self._origin, self.cell, self._table)

    def closed(self, radius: float) -> GridField:
        """The field of a coarser closing, by a ball of `radius` metres: for the first steps of a wrap."""
        pad = int(np.ceil(radius / self.cell)) + 2
        solid = np.pad(self._table <= 0, pad)
        reached = ndimage.distance_transform_edt(~solid) * self.cell > radius
        table = radius - ndimage.distance_transform_edt(~reached) * self.cell
        return GridField(self._origin - pad * self.cell, self.cell, table)

    @property
    def cell(self) -> float:
        """Side of a cell of the grid, metres."""
        return float(np.ptp(self.vertices, axis=0).max() / CELLS)

    @cached_property
    def leaks(self) -> bool:
        """Whether the surface has a hole that the ball gets through."""
        enclosed = self._enclosed(np.zeros(self._shape, bool)) & self._off_surface
        return bool(enclosed.sum() < LEAK * (self._hidden & self._off_surface).sum())

    @property
    def _origin(self) -> Floats:
        low: Floats = self.vertices.min(0) - MARGIN_CELLS * self.cell
        return low

    @property
    def _shape(self) -> tuple[int, int, int]:
        a, b, c = np.ceil(np.ptp(self.vertices, axis=0) / self.cell).astype(int) + 2 * MARGIN_CELLS + 1
        return int(a), int(b), int(c)

    @cached_property
    def _surface(self) -> cKDTree:
        return cKDTree(surface_points(self.vertices, self.faces, 0.5 * self.cell))

    @cached_property
    def _distance(self) -> Floats:
        """Distance (shape) of each grid point to the surface."""
        return self._distances(self._surface)

    def _distances(self, points: cKDTree) -> Floats:
        """Distance (shape) of each grid point to the nearest point: exact near it, to a cell's half beyond BAND."""
        wall = np.zeros(self._shape, bool)
        wall[tuple(np.round((points.data - self._origin) / self.cell).astype(int).T)] = True
        table: Floats = ndimage.distance_transform_edt(~wall) * self.cell
        band = np.argwhere(table < BAND * self.cell)
        table[tuple(band.T)] = points.query(self._origin + self.cell * band)[0]
        return table

    @cached_property
    def _hidden(self) -> AnyArray:
        """Grid points with surface on both sides along at least two axes."""
        wall = self._distance < 0.6 * self.cell
        votes = np.zeros(self._shape, np.int8)
        for axis in range(3):
            before = np.maximum.accumulate(wall, axis)
            after = np.flip(np.maximum.accumulate(np.flip(wall, axis), axis), axis)
            votes += before & after
        return votes >= 2

    @property
    def _off_surface(self) -> AnyArray:
        off: AnyArray = self._distance > self.cell
        return off

    def _reached(self, filled: AnyArray) -> AnyArray:
        """Where the ball's centre gets from outside."""
        radius = CLOSED_BY * self.cell
        free = self._distance > radius
        if filled.any():
            free &= ndimage.distance_transform_edt(~filled) > CLOSED_BY
        labels, _ = ndimage.label(free)
        reached: AnyArray = labels == labels[0, 0, 0]
        return reached

    def _enclosed(self, filled: AnyArray) -> AnyArray:
        return ndimage.distance_transform_edt(~self._reached(filled)) > CLOSED_BY

    @cached_property
    def _table(self) -> Floats:
        if (self._hidden & self._off_surface).sum() < LEAST_CELLS:
            raise CategoryError(NOTHING_INSIDE)
        filled = ndimage.binary_erosion(self._hidden) if self.leaks else np.zeros(self._shape, bool)
        reached, radius = self._reached(filled), CLOSED_BY * self.cell
        border = reached & ~ndimage.binary_erosion(reached, border_value=1)
        edge = self._origin + self.cell * np.argwhere(border)
        distance, nearest = map(np.asarray, self._surface.query(edge))
        onto = distance < radius + 1.2 * self.cell  # the level set itself: cells are too coarse
        shift = (distance - radius) / np.maximum(distance, 1e-9)
        edge[onto] -= (shift[:, None] * (edge - self._surface.data[nearest]))[onto]
        away = self._distances(cKDTree(edge))
        table: Floats = np.where(reached, radius + away, radius - away)
        return table


@dataclass(frozen=True, eq=False)
class GridField:
    """A field as a table on a grid."""

    origin: Floats
    cell: float
    table: Floats

    def __call__(self, points: Floats) -> Floats:
        """Value (n,) at points (n, 3); beyond the grid the distance to it is added."""
        at = (points - self.origin).T / self.cell
        near: Floats = ndimage.map_coordinates(self.table, at, order=1, mode="nearest")
        beyond = np.clip(at, 0, np.array(self.table.shape)[:, None] - 1) - at
        away: Floats = near + self.cell * np.linalg.norm(beyond, axis=0)
        return away


def surface_points(vertices: Floats, faces: Ints, spacing: float) -> Floats:
    """Points (n, 3) on the faces, nowhere sparser than `spacing`: each face as a lattice of its own fineness."""
    corners = vertices[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    pieces = np.maximum(np.ceil(longest / spacing), 1).astype(int)
    rows = [vertices[np.unique(faces)]]
    for n in np.unique(pieces):
        i, j = (k.ravel() for k in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
        kept = i + j <= n
        shares = np.stack([i, j, n - i - j], 1)[kept] / n
        rows.append(np.einsum("sc,fck->fsk", shares, corners[pieces == n]).reshape(-1, 3))
    points = np.concatenate(rows)
    cells = np.unique(np.round(points / (0.25 * spacing)).astype(np.int64), axis=0, return_index=True)[1]
    sparse: Floats = points[np.sort(cells)]
    return sparse
