"""Which cars are fitted to their views of all drives, and which turn out to be one by that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from meshslam.categories import Category, load_category
from meshslam.errors import CategoryError
from meshslam.merging.config import MergingConfig
from meshslam.merging.drives import Drive
from meshslam.merging.laying import LaidComponent
from meshslam.merging.links import Progress
from meshslam.merging.places import Place
from meshslam.merging.refitting import FusedCar, Refitted, Refitting, refit_cars, refitting_of
from meshslam.objects import ObjectConfig


def fitted_together(
    drives: Sequence[Drive],
    laid: LaidComponent,
    cars: Sequence[FusedCar],
    objects: ObjectConfig,
    config: MergingConfig,
    categories: Mapping[str, Category],
    progress: Progress | None,
) -> tuple[list[FusedCar], list[str]]:
    """The cars, those of several drives fitted to all views, and notes on those whose views contradict each other.

    Where two drives have a car in two places near each other, and one car explains the views of both, it is one.
    """
    found, notes = list(cars), list[str]()
    for name in sorted({car.thing.category for car in cars}):
        category = _category(name, categories)
        shared = None if category is None else refitting_of(drives, laid, category, objects, config)
        if shared is not None:
            found = _joined(shared, found, name, config)
            found, said = _fitted(shared, found, name, progress)
            notes += said
    return found, notes


def _fitted(
    shared: Refitting, cars: Sequence[FusedCar], category: str, progress: Progress | None
) -> tuple[list[FusedCar], list[str]]:
    """All cars of a category that several drives saw, by their views."""
    found, notes = list(cars), list[str]()
    rows = [k for k, car in enumerate(cars) if len(car.place.members) > 1 and car.thing.category == category]
    fits = refit_cars(shared, [cars[k] for k in rows], progress)
    for k, fit in zip(rows, fits, strict=True):
        if fit.thing is not None:
            found[k] = replace(cars[k], thing=fit.thing)
        elif fit.is_conflict:
            notes.append(_said(shared.drives, cars[k].place, fit))
    return found, notes


def _joined(shared: Refitting, cars: Sequence[FusedCar], category: str, config: MergingConfig) -> list[FusedCar]:
    """The cars, two of different drives joined where one explains the views of both: one estimate was poor."""
    found = list(cars)
    for one, other in _near(cars, category, config.max_joined_m):
        if one not in found or other not in found:
            continue
        trial = _as_one(one, other)
        [fit] = refit_cars(shared, [trial])
        if fit.thing is not None:
            found[found.index(one)] = trial
            found.remove(other)
    return found


def _near(cars: Sequence[FusedCar], category: str, within_m: float) -> list[tuple[FusedCar, FusedCar]]:
    """Cars of no common drive that stand near each other, the nearest first."""
    rows = [car for car in cars if car.thing.category == category]
    pairs = []
    for j, other in enumerate(rows):
        for i, one in enumerate(rows[:j]):
            gap = one.thing.world_from_object.translation - other.thing.world_from_object.translation
            away = float(np.linalg.norm(gap[:2]))
            if away <= within_m and not set(one.place.members) & set(other.place.members):
                pairs.append((away, i, j))
    return [(rows[i], rows[j]) for _, i, j in sorted(pairs)]


def _as_one(one: FusedCar, other: FusedCar) -> FusedCar:
    """Both as one car, which may stand in either place; what more views tell is the first guess."""
    better, worse = (one, other) if one.thing.views >= other.thing.views else (other, one)
    members = {**one.place.members, **other.place.members}
    ious = [(car.thing.mask_iou, car.thing.views) for car in (one, other) if car.thing.mask_iou is not None]
    mean = sum(iou * views for iou, views in ious) / max(1, sum(views for _, views in ious)) if ious else None
    thing = replace(better.thing, id=min(one.thing.id, other.thing.id), mask_iou=mean)
    place = Place(members, one.place.turned | other.place.turned)
    return FusedCar(place, thing, (worse.thing.world_from_object,))


def _said(drives: Sequence[Drive], place: Place, fit: Refitted) -> str:
    cars = ", ".join(f"{drives[d].name}/{number}" for d, number in sorted(place.members.items()))
    return f"{cars}: {fit.reason}: fused by the figures of the maps"


def _category(name: str, categories: Mapping[str, Category]) -> Category | None:
    """None for a category that is not at hand: its cars are fused by their figures."""
    if name in categories:
        return categories[name]
    try:
        return load_category(name)
    except CategoryError:
        return None
