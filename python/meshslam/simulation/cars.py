"""Cars to draw: finely meshed procedural cars, each with its own measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.categories import (
    CarShape,
    Wrapper,
    car_template,
    carry,
    distance_and_normal,
    draw_car,
    icosphere,
    middle_car,
    project,
    subdivide,
)
from meshslam.geometry import Floats, Ints

SUBDIVISIONS = 2  # beyond the category's mesh: edges of about 5 cm


@dataclass(frozen=True, eq=False)
class ProceduralCar:
    """A car's surface; x forward from the middle of the wheelbase, y left, z up from the ground, metres."""

    shape: CarShape
    vertices: Floats  # (V, 3)
    faces: Ints  # (F, 3)
    face_normals: Floats  # (F, 3), smoothed: means of the corners' normals
    keypoints: Floats  # (12, 3), in the order of KEYPOINT_NAMES
    coarse: int  # the first so many vertices are those of the category's mesh

    @property
    def middle(self) -> Floats:
        """Centre (3,) of the bounding box."""
        centre: Floats = (self.vertices.max(0) + self.vertices.min(0)) / 2
        return centre


def make_cars(seed: int, count: int) -> list[ProceduralCar]:
    """Draw `count` cars; the same seed gives the same cars."""
    rng = np.random.default_rng(seed)
    return meshed_cars([draw_car(rng) for _ in range(count)])


def meshed_cars(shapes: Sequence[CarShape]) -> list[ProceduralCar]:
    """Lay a fine mesh onto each of the solids."""
    wrapper, middle = Wrapper(icosphere(3)), middle_car()
    template, landmarks = car_template(wrapper, middle), middle.landmarks()
    faces = wrapper.sphere.faces
    return [_meshed(car, wrapper.fit(car.field, carry(template, landmarks, car.landmarks())), faces) for car in shapes]


def _meshed(car: CarShape, coarse: Floats, faces: Ints) -> ProceduralCar:
    """Refine the category's mesh and lay it on the solid once more."""
    vertices = coarse
    for _ in range(SUBDIVISIONS):
        vertices, faces = subdivide(vertices, faces)
    vertices = project(car.field, vertices, 3)
    _, normal = distance_and_normal(car.field, vertices, 0.01)
    mean = normal[faces].mean(1)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
    return ProceduralCar(car, vertices, faces, mean, car.keypoints(), len(coarse))
