"""Build the category `car` from its procedural family."""

from __future__ import annotations

import numpy as np

from meshslam.categories.category import Category
from meshslam.categories.icosphere import icosphere
from meshslam.categories.keypoints import mirrored_weights, point_weights
from meshslam.categories.modes import principal_modes
from meshslam.categories.procedural.car import KEYPOINT_NAMES, CarShape
from meshslam.categories.procedural.styles import draw_car
from meshslam.categories.shrinkwrap import Wrapper, carry
from meshslam.categories.template import car_template, middle_car
from meshslam.errors import CategoryError
from meshslam.geometry.arrays import Floats, Ints

SHIPPED_SEED, SHIPPED_COUNT, SHIPPED_MODES = 0, 240, 20


def build_car(seed: int = SHIPPED_SEED, count: int = SHIPPED_COUNT, modes: int = SHIPPED_MODES) -> Category:
    """Draw `count` cars, lay the template onto each, and take mean and principal modes.

    The same arguments give the same category; the defaults give the shipped one. CategoryError if there are fewer
    cars than modes + 1.
    """
    if modes < 1 or count < modes + 1:
        raise CategoryError(f"{modes} modes need at least {modes + 1} cars and one mode, found count={count}")
    wrapper, rng = Wrapper(icosphere(3)), np.random.default_rng(seed)
    sphere = wrapper.sphere
    shapes, points = wrapped_cars(wrapper, [draw_car(rng) for _ in range(count)])
    mean, directions = principal_modes(shapes, sphere.faces, modes)
    mean = wrapper.symmetrized(mean - (mean.max(0) + mean.min(0)) / 2)
    return Category(
        name="car",
        vertices=mean,
        faces=sphere.faces,
        modes=np.array([wrapper.symmetrized(d) for d in directions]),
        mirror=sphere.mirror,
        keypoint_names=KEYPOINT_NAMES,
        keypoint_weights=mirrored_weights(point_weights(shapes, points), sphere.mirror, KEYPOINT_NAMES),
        wheel_vertices=wheel_vertices(mean, sphere.mirror),
    )


def wrapped_cars(wrapper: Wrapper, cars: list[CarShape]) -> tuple[Floats, Floats]:
    """Vertices (N, V, 3) and key points (N, K, 3) of the cars, each about the centre of its bounding box."""
    middle = middle_car()
    template, landmarks = car_template(wrapper, middle), middle.landmarks()
    shapes, points = [], []
    for car in cars:
        shape = wrapper.fit(car.field, carry(template, landmarks, car.landmarks()))
        centre = (shape.max(0) + shape.min(0)) / 2 * [1, 0, 1]
        shapes.append(shape - centre)
        points.append(car.keypoints() - centre)
    return np.array(shapes), np.array(points)


def wheel_vertices(vertices: Floats, mirror: Ints, each: int = 3) -> Ints:
    """Indices of the lowest vertices under each of the four wheels, sorted; symmetric."""
    found: list[int] = []
    for front in (True, False):
        side = np.flatnonzero((vertices[:, 1] > 0) & ((vertices[:, 0] > 0) == front))
        lowest = side[np.argsort(vertices[side, 2], kind="stable")[:each]]
        found += [*lowest.tolist(), *mirror[lowest].tolist()]
    return np.array(sorted(set(found)), dtype=np.int64)
