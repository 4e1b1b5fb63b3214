"""Cars to draw: finely meshed procedural cars, each with its own measures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from meshslam.categories import (
    CarShape,
    Wrapper,
    car_template,
    carry,
    distance_and_normal,
    draw_bus,
    draw_car,
    draw_truck,
    draw_van,
    icosphere,
    middle_car,
    project,
    subdivide,
)
from meshslam.geometry import Floats, Ints

Kind = Literal["car", "van", "truck", "bus"]
SUBDIVISIONS = 2  # beyond the category's mesh: edges of about 5 cm
_FAMILIES: dict[Kind, Callable[[np.random.Generator], CarShape]] = {
    "car": draw_car,
    "van": draw_van,
    "truck": draw_truck,
    "bus": draw_bus,
}
_FLEET: dict[Kind, float] = {"van": 0.55, "car": 0.15, "truck": 0.16, "bus": 0.14}  # shares of a fleet's vehicles


@dataclass(frozen=True, eq=False)
class ProceduralCar:
    """A car's surface; x forward from the middle of the wheelbase, y left, z up from the ground, metres."""

    shape: CarShape
    vertices: Floats  # (V, 3)
    faces: Ints  # (F, 3)
    face_normals: Floats  # (F, 3), smoothed: means of the corners' normals
    keypoints: Floats  # (12, 3), in the order of KEYPOINT_NAMES
    coarse: int  # the first so many vertices are those of the category's mesh
    kind: Kind = "car"

    @property
    def middle(self) -> Floats:
        """Centre (3,) of the bounding box."""
        centre: Floats = (self.vertices.max(0) + self.vertices.min(0)) / 2
        return centre


def make_cars(seed: int, count: int) -> list[ProceduralCar]:
    """Draw `count` cars; the same seed gives the same cars."""
    rng = np.random.default_rng(seed)
    return meshed_cars([draw_car(rng) for _ in range(count)])


def make_fleet(seed: int, count: int) -> list[ProceduralCar]:
    """Draw `count` vehicles, most of them vans, with trucks, buses and cars; the same seed gives the same vehicles."""
    rng = np.random.default_rng(seed)
    shares = np.array(list(_FLEET.values()))
    drawn = rng.choice(len(shares), size=count, p=shares / shares.sum())
    kinds = [list(_FLEET)[int(i)] for i in drawn]
    drawn_of = {kind: [_FAMILIES[kind](rng) for k in kinds if k == kind] for kind in _FLEET}
    return [car for kind, shapes in drawn_of.items() if shapes for car in meshed_cars(shapes, kind)]


def meshed_cars(shapes: Sequence[CarShape], kind: Kind = "car") -> list[ProceduralCar]:
    """Lay a fine mesh onto each of the solids, all of one kind."""
    wrapper, template, landmarks = _template(kind)
    faces = wrapper.sphere.faces
    return [
        _meshed(car, wrapper.fit(car.field, carry(template, landmarks, car.landmarks())), faces, kind) for car in shapes
    ]


@cache
def _template(kind: Kind) -> tuple[Wrapper, Floats, Floats]:
    """The mesh of a family's middle vehicle, what lays it on others, and that vehicle's landmarks."""
    wrapper, middle = Wrapper(icosphere(3)), middle_car(_FAMILIES[kind])
    return wrapper, car_template(wrapper, middle), middle.landmarks()


def _meshed(car: CarShape, coarse: Floats, faces: Ints, kind: Kind) -> ProceduralCar:
    """Refine the category's mesh and lay it on the solid once more."""
    vertices = coarse
    for _ in range(SUBDIVISIONS):
        vertices, faces = subdivide(vertices, faces)
    vertices = project(car.field, vertices, 3)
    _, normal = distance_and_normal(car.field, vertices, 0.01)
    mean = normal[faces].mean(1)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
    return ProceduralCar(car, vertices, faces, mean, car.keypoints(), len(coarse), kind)
