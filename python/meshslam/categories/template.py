"""The template: the sphere laid once onto a middle car, from where it is carried to every other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace

import numpy as np

from meshslam.categories.procedural.car import CarShape
from meshslam.categories.procedural.solid import Field, project
from meshslam.categories.procedural.styles import draw_car
from meshslam.categories.shrinkwrap import FLIP, Wrapper
from meshslam.geometry import Floats

ON_THE_GROUND = 0.03  # clearance of the car that the wheels grow from
GROWTH = 0.15  # of the mirrors' reach


def middle_car(draw: Callable[[np.random.Generator], CarShape] = draw_car) -> CarShape:
    """The car with the mean measures of a family, which `draw` draws from."""
    rng = np.random.default_rng(0)
    drawn = [asdict(draw(rng)) for _ in range(400)]
    return CarShape(**{key: float(np.mean([d[key] for d in drawn])) for key in drawn[0]})


def car_template(wrapper: Wrapper, car: CarShape) -> Floats:
    """Lay the sphere onto a car, vertices dense where its shape bends; (V, 3) in the solid's frame.

    Wheels and mirrors grow out of a car that lies on the ground without mirrors, so that the vertices at their feet
    become theirs.
    """
    density = _density(car)
    lying = replace(car, clearance=ON_THE_GROUND, chin=0.2, rear_lip=0.25, mirror_reach=car.mirror_reach - 0.25)
    middle = np.array([(car.front + car.rear) / 2, 0, car.height / 2])
    ball = wrapper.sphere.vertices * [car.length * 0.55, car.width * 0.6, car.height * 0.6] + middle
    vertices = wrapper.symmetrized(project(lying.field, ball, 12))
    vertices = wrapper.relax(lying.field, vertices, density, 250)
    tip = int(np.linalg.norm(vertices - _mirror_foot(car, 0.1), axis=1).argmin())
    for share in np.linspace(0, 1, 9):
        grown = _grown(car, float(share))
        vertices = wrapper.symmetrized(project(grown.field, vertices, 4))
        vertices = wrapper.relax(grown.field, vertices, density, 3)
        vertices = _pulled(wrapper, vertices, tip, grown.mirror_tip)
    return wrapper.fit(car.field, vertices, smoothness=0.1)


def _pulled(wrapper: Wrapper, vertices: Floats, tip: int, target: Floats) -> Floats:
    """Put a left vertex and its mirror image on the mirrors' tips; their neighbourhood follows, but not outwards."""
    near = np.exp(-((vertices - vertices[tip]) ** 2).sum(1) / 0.25**2)
    followed = vertices + near[:, None] * (target - vertices[tip]) * [1, 0, 1]
    left = vertices[:, 1:2] > 0
    moved: Floats = np.where(left, followed, followed[wrapper.sphere.mirror] * FLIP)
    moved[wrapper.sphere.plane] = vertices[wrapper.sphere.plane]
    moved[[tip, wrapper.sphere.mirror[tip]]] = [target, target * FLIP]
    return moved


def _grown(car: CarShape, share: float) -> CarShape:
    """The car with wheels and mirrors that share of their way out."""
    clearance = ON_THE_GROUND + share * (car.clearance - ON_THE_GROUND)
    return replace(car, clearance=clearance, mirror_reach=car.mirror_reach - (1 - share) * GROWTH)


def _mirror_foot(car: CarShape, inside: float) -> Floats:
    """The point that far inside the widest line behind the left mirror."""
    foot: Floats = car.mirror_tip - [0, car.mirror_reach + inside, 0]
    return foot


def _density(car: CarShape) -> Field:
    """How many vertices a place deserves: many at wheels and mirrors, some at both ends, few under the body."""

    def density(points: Floats) -> Floats:
        x, y, z = points[:, 0], np.abs(points[:, 1]), points[:, 2]
        to_wheel = [
            np.maximum(np.abs(np.abs(x) - car.wheelbase / 2) - 0.25, 0),
            np.maximum(np.abs(y - car.width / 2 + 0.14) - 0.14, 0),
            np.maximum(z - car.clearance, 0),
        ]
        wheels = np.exp(-(np.square(to_wheel).sum(0)) / 0.2**2)
        mirrors = np.exp(-((np.column_stack([x, y, z]) - _mirror_foot(car, 0.04)) ** 2).sum(1) / 0.16**2)
        ends = np.clip((np.abs(x - (car.front + car.rear) / 2) - car.length / 2 + 0.4) / 0.4, 0, 1)
        under = np.clip((car.clearance + 0.06 - z) / 0.05, 0, 1)
        value: Floats = (1 + 2 * ends) * (1 - 0.7 * under) + 9 * wheels + 10 * mirrors
        return value

    return density
