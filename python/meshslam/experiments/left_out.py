"""Instances whose kind the shape space has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.categories import (
    CLASSES,
    CarClass,
    Category,
    Wrapper,
    category_of,
    draw_of_class,
    icosphere,
    middle_car,
    wrapped_cars,
)
from meshslam.simulation import Body, meshed_cars, procedural_body


@dataclass(frozen=True, eq=False)
class Instance:
    """A car, and the category of cars of all other kinds."""

    kind: str  # its rear end, as `procedural.styles` has it
    body: Body
    category: Category


def left_out_instances(kinds: Sequence[str], seed: int, family: int, modes: int) -> list[Instance]:
    """A car of each kind, with the shape space of those of `family` drawn cars that are of another kind."""
    rng = np.random.default_rng(seed)
    of_kind = {kind: [c for c in CLASSES if c.style == kind] for kind in kinds}
    chosen = [draw_of_class(_drawn(of_kind[kind], rng), rng) for kind in kinds]
    classes = [_drawn(CLASSES, rng) for _ in range(family)]
    wrapper = Wrapper(icosphere(3))
    shapes, points = wrapped_cars(wrapper, [draw_of_class(c, rng) for c in classes], middle_car())
    styles = np.array([c.style for c in classes])
    return [
        Instance(
            kind,
            procedural_body(car),
            category_of("car", wrapper, shapes[styles != kind], points[styles != kind], modes),
        )
        for kind, car in zip(kinds, meshed_cars(chosen), strict=True)
    ]


def _drawn(classes: Sequence[CarClass], rng: np.random.Generator) -> CarClass:
    """One of the classes by their shares."""
    shares = np.array([c.share for c in classes])
    return classes[int(rng.choice(len(classes), p=shares / shares.sum()))]
