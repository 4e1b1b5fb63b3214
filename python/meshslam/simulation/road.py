"""A road: its middle line in space, and the ground around it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from scipy.spatial import cKDTree

from meshslam.geometry import Floats, Ints, Pose

_STEP_M = 0.25  # between the points of the line that places are looked up by
_CELL_M = 0.5  # of the tables along, aside, height
_TILE_M = 4.0  # of the ground's mesh
_REACH_M = 70.0  # ground beyond the line's ends and sides
_AXLES_M = 2.6  # over which a car takes the road's slope
_ROW = 1024


@dataclass(frozen=True, eq=False)
class Road:
    """The middle line (n, 3) of a road on the ground, in world; `along` counts metres from its first point."""

    line: Floats
    start_m: float = 0.0  # `along` at the first point

    @cached_property
    def _fine(self) -> tuple[Floats, Floats]:
        """Metres along (m,), and the points there (m, 3)."""
        steps = np.linalg.norm(np.diff(self.line[:, :2], axis=0), axis=1)
        at = np.concatenate([[0.0], np.cumsum(steps)])
        even = np.linspace(0.0, at[-1], max(2, round(at[-1] / _STEP_M) + 1))
        return even + self.start_m, np.column_stack([np.interp(even, at, column) for column in self.line.T])

    @property
    def end_m(self) -> float:
        """`along` at the last point."""
        return float(self._fine[0][-1])

    def point(self, along_m: float, aside_m: float = 0.0) -> Floats:
        """Point (3,) on the ground, `aside_m` to the left of the middle; beyond the ends the line goes on straight."""
        at, points = self._fine
        here = np.array([np.interp(along_m, at, column) for column in points.T])
        ahead = self._direction(along_m)
        over = along_m - float(np.clip(along_m, at[0], at[-1]))
        left = np.array([-ahead[1], ahead[0], 0.0])
        shifted: Floats = here + over * ahead + aside_m * left
        return shifted

    def heading_rad(self, along_m: float) -> float:
        """Direction of the road about z."""
        ahead = self._direction(along_m)
        return float(np.arctan2(ahead[1], ahead[0]))

    def pose(self, along_m: float, aside_m: float, height_m: float, turn_rad: float = 0.0) -> Pose:
        """world_from_object of what stands on the road, `height_m` below its origin, turned from its heading."""
        behind, ahead = (self.point(along_m + k * _AXLES_M / 2)[2] for k in (-1, 1))
        slope = float(np.arctan2(ahead - behind, _AXLES_M))
        c, s = np.cos(slope), np.sin(slope)
        tilt = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        heading = Pose.from_yaw(self.heading_rad(along_m), np.zeros(3)).rotation
        rotation = heading @ tilt @ Pose.from_yaw(turn_rad, np.zeros(3)).rotation
        return Pose(rotation, self.point(along_m, aside_m) + height_m * (heading @ tilt)[:, 2])

    def along_of(self, points: Floats) -> Floats:
        """Metres along (n,) of the line's points nearest to points (n, 2 or 3)."""
        at, fine = self._fine
        _, nearest = cKDTree(fine[:, :2]).query(points[:, :2])
        found: Floats = at[nearest]
        return found

    def coordinates(self, points_in_world: Floats) -> tuple[Floats, Floats]:
        """Metres along and to the left (n,) of points (n, 3) within reach of the ground."""
        (low, _), tables = self._tables
        places = (points_in_world[:, :2] - low) / _CELL_M
        along, aside = (_sampled(table, places) for table in tables[:2])
        return along, aside

    @cached_property
    def ground(self) -> tuple[Floats, Ints]:
        """The ground's mesh: vertices (v, 3), faces (f, 3)."""
        (low, high), tables = self._tables
        x, y = (np.arange(low[i], high[i] + 1e-9, _TILE_M) for i in range(2))
        grid = np.stack(np.meshgrid(x, y), -1)
        every = round(_TILE_M / _CELL_M)
        height = tables[2][::every, ::every][: len(y), : len(x)]
        number = np.arange(grid.shape[0] * grid.shape[1]).reshape(grid.shape[:2])
        a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
        faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
        return np.concatenate([grid, height[..., None]], -1).reshape(-1, 3), faces

    @cached_property
    def _tables(self) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats, Floats]]:
        """Corners of the ground, and along, aside, height (rows, columns) on its grid."""
        at, fine = self._fine
        low = np.floor((fine[:, :2].min(0) - _REACH_M) / _TILE_M) * _TILE_M
        high = np.ceil((fine[:, :2].max(0) + _REACH_M) / _TILE_M) * _TILE_M
        x, y = (np.arange(low[i], high[i] + 1e-9, _CELL_M) for i in range(2))
        grid = np.stack(np.meshgrid(x, y), -1)
        _, nearest = cKDTree(fine[:, :2]).query(grid)
        directions = np.gradient(fine[:, :2], axis=0)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        ahead, gap = directions[nearest], grid - fine[nearest][..., :2]
        along = at[nearest] + (gap * ahead).sum(-1)
        aside = ahead[..., 0] * gap[..., 1] - ahead[..., 1] * gap[..., 0]
        return (low, high), (along, aside, fine[nearest][..., 2])

    def _direction(self, along_m: float) -> Floats:
        """Unit vector (3,) along the road, level."""
        at, points = self._fine
        on_line = np.clip(along_m, at[0] + _STEP_M, at[-1] - _STEP_M)
        before, after = (np.clip(on_line + k, at[0], at[-1]) for k in (-0.5, 0.5))
        ends = [np.array([np.interp(s, at, column) for column in points.T]) for s in (before, after)]
        ahead = (ends[1] - ends[0]) * [1.0, 1.0, 0.0]
        unit: Floats = ahead / np.linalg.norm(ahead)
        return unit


def _sampled(table: Floats, places: Floats) -> Floats:
    """Values (n,) of a table between its cells, at columns and rows (n, 2)."""
    padded = np.zeros((-(-len(places) // _ROW) * _ROW, 2), np.float32)  # remap takes pictures of fewer than 32768 rows
    padded[: len(places)] = places
    x, y = padded.T.reshape(2, -1, _ROW)
    found = cv2.remap(table.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, float).reshape(-1)[: len(places)]
