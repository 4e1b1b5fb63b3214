"""Build the shipped categories from their procedural families."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from meshslam.categories.category import Category
from meshslam.categories.keypoints import KEYPOINT_NAMES, mirrored_weights, point_weights
from meshslam.categories.modes import principal_modes
from meshslam.categories.procedural.car import CarShape
from meshslam.categories.procedural.heavy import draw_bus, draw_truck
from meshslam.categories.procedural.styles import draw_car
from meshslam.categories.shrinkwrap import Wrapper, carry
from meshslam.categories.spheres import icosphere
from meshslam.categories.template import car_template, middle_car
from meshslam.errors import CategoryError
from meshslam.geometry import Floats, Ints

SHIPPED_SEED, SHIPPED_COUNT, SHIPPED_MODES = 0, 240, 20
FAMILIES: dict[str, Callable[[np.random.Generator], CarShape]] = {
    "car": draw_car,
    "truck": draw_truck,
    "bus": draw_bus,
}


def build_family(
    name: str, seed: int = SHIPPED_SEED, count: int = SHIPPED_COUNT, modes: int = SHIPPED_MODES
) -> Category:
    """Draw `count` vehicles of a family, lay the template onto each, and take mean and principal modes.

    The same arguments give the same category; the defaults give the shipped one. CategoryError if there is no such
    family, or fewer vehicles than modes + 1.
    """
    if name not in FAMILIES:
        raise CategoryError(f"no family {name!r}: {', '.join(FAMILIES)} are built without meshes; else name mesh files")
    if modes < 1 or count < modes + 1:
        raise CategoryError(f"{modes} modes need at least {modes + 1} {name}s and one mode, found count={count}")
    draw = FAMILIES[name]
    wrapper, rng = Wrapper(icosphere(3)), np.random.default_rng(seed)
    shapes, points = wrapped_cars(wrapper, [draw(rng) for _ in range(count)], middle_car(draw))
    return category_of(name, wrapper, shapes, points, modes)


def category_of(name: str, wrapper: Wrapper, shapes: Floats, points: Floats, modes: int) -> Category:
    """Mean and principal modes of wrapped shapes (N, V, 3) with their key points (N, K, 3)."""
    sphere = wrapper.sphere
    mean, directions = principal_modes(shapes, sphere.faces, modes)
    mean = wrapper.symmetrized(mean - (mean.max(0) + mean.min(0)) / 2)
    return Category(
        name=name,
        vertices=mean,
        faces=sphere.faces,
        modes=np.array([wrapper.symmetrized(d) for d in directions]),
        mirror=sphere.mirror,
        keypoint_names=KEYPOINT_NAMES,
        keypoint_weights=mirrored_weights(point_weights(shapes, points), sphere.mirror, KEYPOINT_NAMES),
        wheel_vertices=wheel_vertices(mean, sphere.mirror),
    )


def build_car(seed: int = SHIPPED_SEED, count: int = SHIPPED_COUNT, modes: int = SHIPPED_MODES) -> Category:
    """Build the category `car`: see `build_family`."""
    return build_family("car", seed, count, modes)


def wrapped_cars(wrapper: Wrapper, cars: list[CarShape], middle: CarShape) -> tuple[Floats, Floats]:
    """Vertices (N, V, 3) and key points (N, K, 3) of the cars, each about the centre of its bounding box.

    The template is laid onto the `middle` one and carried to the others.
    """
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
