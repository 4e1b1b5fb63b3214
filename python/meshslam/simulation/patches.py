"""Points of a vehicle's surface that are to be painted, and the patches they lie in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.categories import CarShape
from meshslam.geometry import Bools, Floats


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points (n,) in the vehicle's frame with their normals."""

    x: Floats
    y: Floats
    z: Floats
    nx: Floats
    ny: Floats  # positive outwards on both sides
    nz: Floats
    share: Floats  # z over the vehicle's height
    half: Floats  # half width there

    @property
    def out(self) -> Floats:
        """Distance from the middle plane."""
        return np.abs(self.y)


def surface_points(car: CarShape, points: Floats, normals: Floats) -> SurfacePoints:
    """Points (n, 3) with normals (n, 3), both in the vehicle's frame."""
    x, y, z = points.T
    outwards = normals[:, 1] * np.sign(y + 1e-9)
    return SurfacePoints(x, y, z, normals[:, 0], outwards, normals[:, 2], z / car.height, car.half_width(x, z))


def rounded_box(a: Floats, b: Floats, half_a: Floats | float, half_b: Floats | float, power: float = 4.0) -> Bools:
    """Points in a rounded rectangle about the origin."""
    inside: Bools = np.abs(a / half_a) ** power + np.abs(b / half_b) ** power < 1.0
    return inside
