"""House fronts along a road."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Ints
from meshslam.simulation.road import Road

PAVEMENT_M = 3.0  # between kerb and fronts


@dataclass(frozen=True, eq=False)
class Wall:
    """A house front: an upright rectangle from `start` to `end` (3,), on the ground."""

    start: Floats
    end: Floats
    height_m: float
    colour_bgr: Floats  # (3,), 0 to 1

    @property
    def vertices(self) -> Floats:
        """Corners (4, 3), in world; the lower ones are in the ground."""
        low = np.array([self.start, self.end])
        return np.concatenate([low - [0.0, 0.0, 1.0], low + [0.0, 0.0, self.height_m]])

    @property
    def faces(self) -> Ints:
        """Both triangles, seen from both sides alike."""
        return np.array([[0, 1, 2], [1, 3, 2]])

    @property
    def normal(self) -> Floats:
        """Unit normal (3,)."""
        along = (self.end - self.start) * [1.0, 1.0, 0.0]
        return np.cross(along / np.linalg.norm(along), [0.0, 0.0, 1.0])


def walls_along(road: Road, rng: np.random.Generator, kerb_m: float) -> tuple[Wall, ...]:
    """House fronts along both pavements, and one that closes the street."""
    walls: list[Wall] = []
    back = kerb_m + PAVEMENT_M
    for side in (-back, back):
        along = road.start_m
        while along < road.end_m - 2.0:
            width = rng.uniform(8.0, 16.0)
            colour = np.array([0.55, 0.62, 0.68]) * rng.uniform(0.85, 1.15, 3)
            ends = road.point(along, side), road.point(along + width, side)
            walls.append(Wall(*ends, rng.uniform(6.0, 13.0), np.clip(colour, 0.0, 1.0)))
            along += width
    across = road.point(road.end_m, -25.0), road.point(road.end_m, 25.0)
    walls.append(Wall(*across, 9.0, np.array([0.5, 0.56, 0.6])))
    return tuple(walls)
