"""What stands in a street: meshes with key points, and what their surfaces look like."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import cycle
from typing import Protocol

import numpy as np

from meshslam.categories import KEYPOINT_NAMES, Category
from meshslam.geometry import Floats, Ints
from meshslam.simulation.body_looks import look_of
from meshslam.simulation.cars import ProceduralCar, make_cars
from meshslam.simulation.look import Look
from meshslam.simulation.materials import surface


class Skin(Protocol):
    """The surface of a body."""

    @property
    def paint_bgr(self) -> Floats:
        """The colour (3,) of most of it, 0 to 1."""
        ...

    def at(self, points: Floats, normals: Floats) -> tuple[Floats, Floats]:
        """Colours (n, 3), BGR from 0 to 1, and mirrored shares (n,) of light at points with normals (n, 3)."""
        ...


@dataclass(frozen=True, eq=False)
class PlainSkin:
    """One colour all over."""

    paint_bgr: Floats

    def at(self, points: Floats, normals: Floats) -> tuple[Floats, Floats]:
        """See Skin."""
        return np.tile(self.paint_bgr, (len(points), 1)), np.zeros(len(points))


@dataclass(frozen=True, eq=False)
class CarSkin:
    """Paint, glass, lamps, wheels of a procedural car."""

    car: ProceduralCar
    look: Look

    @property
    def paint_bgr(self) -> Floats:
        """See Skin."""
        return self.look.paint

    def at(self, points: Floats, normals: Floats) -> tuple[Floats, Floats]:
        """See Skin."""
        found = surface(self.car.shape, self.look, points + self.car.middle, normals)
        return found.colour, found.mirror


Looks = Callable[[np.random.Generator], Skin]


@dataclass(frozen=True, eq=False)
class Body:
    """A mesh with key points; the origin of its frame is the centre of its bounding box."""

    category: str
    vertices: Floats  # (V, 3)
    faces: Ints  # (F, 3)
    keypoints: dict[str, Floats]  # (3,)
    looks: Looks  # draws a skin for it

    @property
    def dimensions(self) -> Floats:
        """Length, width, height."""
        size: Floats = np.ptp(self.vertices, axis=0)
        return size

    @cached_property
    def vertex_normals(self) -> Floats:
        """Unit normals (V, 3): means of the faces' around, weighted by area."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        across = np.cross(b - a, c - a)
        total = np.zeros_like(self.vertices)
        for i in range(3):
            np.add.at(total, self.faces[:, i], across)
        unit: Floats = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)
        return unit


BodySource = Callable[[np.random.Generator], Body]

_PLAIN_BGR = np.array(
    [
        [0.75, 0.76, 0.77],  # silver
        [0.88, 0.88, 0.87],  # white
        [0.20, 0.20, 0.21],  # anthracite
        [0.50, 0.26, 0.12],  # blue
        [0.14, 0.12, 0.55],  # red
        [0.28, 0.38, 0.22],  # green
        [0.30, 0.62, 0.75],  # sand
    ]
)


def plain_skin(rng: np.random.Generator) -> Skin:
    """Draw a colour."""
    return PlainSkin(np.clip(_PLAIN_BGR[rng.integers(len(_PLAIN_BGR))] * rng.uniform(0.9, 1.1), 0.0, 1.0))


def shapes_of(category: Category, max_z: float) -> BodySource:
    """Plain bodies of a category's shape space, mode weights cut at `max_z` standard deviations."""

    def draw(rng: np.random.Generator) -> Body:
        z = np.clip(rng.normal(size=len(category.modes)), -max_z, max_z)
        vertices = category.shape(z)
        centred: Floats = vertices - (vertices.max(0) + vertices.min(0)) / 2
        points = dict(zip(category.keypoint_names, category.keypoints(centred), strict=True))
        return Body(category.name, centred, category.faces, points, plain_skin)

    return draw


def procedural_body(car: ProceduralCar) -> Body:
    """A procedural car, to be painted with looks of its own."""

    def looks(rng: np.random.Generator) -> Skin:
        return CarSkin(car, look_of(rng, car.shape, car.kind))

    points = dict(zip(KEYPOINT_NAMES, car.keypoints - car.middle, strict=True))
    return Body("car", car.vertices - car.middle, car.faces, points, looks)


def procedural_bodies(seed: int, count: int) -> BodySource:
    """`count` procedural cars, one after the other; after the last the first comes again. The first call makes them."""
    bodies = _procedural(seed, count)

    def draw(_rng: np.random.Generator) -> Body:
        return next(bodies)

    return draw


def _procedural(seed: int, count: int) -> Iterator[Body]:
    yield from cycle([procedural_body(car) for car in make_cars(seed, count)])
