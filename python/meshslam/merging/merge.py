"""Drives in one world, and the cars of all of them as one map: laid, fused, fitted together, with each visit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from meshslam.categories import Category
from meshslam.errors import MapError
from meshslam.maps import MapObject
from meshslam.merging.config import MergingConfig
from meshslam.merging.drives import Drive
from meshslam.merging.fitting import fitted_together
from meshslam.merging.fusion import fused
from meshslam.merging.laying import LaidComponent, lay_component
from meshslam.merging.links import Progress, link_drives
from meshslam.merging.moves import MergedCar, told_apart
from meshslam.merging.notes import figures_of, notes_of
from meshslam.merging.places import Place, own_covariance, pose_of
from meshslam.merging.refitting import FusedCar
from meshslam.merging.result import LaidDrive, Merged, World
from meshslam.merging.visits import Visit, visit_without
from meshslam.objects import ObjectConfig


def merge_drives(
    drives: Sequence[Drive],
    config: MergingConfig | None = None,
    objects: ObjectConfig | None = None,
    *,
    categories: Mapping[str, Category] | None = None,
    progress: Progress | None = None,
) -> Merged:
    """Lay drives into one world by the cars that they share, and make each car one.

    `drives` are in the order of their times: what a later one shows counts. `objects` are the settings of the fit to
    views; `categories` are those that are not shipped, by name. MapError for fewer than two drives.

    The world is that of the first drive of a component; drives that share too little with any other have worlds of
    their own, and a note says why. Lengths are metres.

    Example:
        drives, _ = read_drives([Path("monday"), Path("tuesday")])
        merged = merge_drives(drives)
        merged.map.save("city")

    """
    config, objects = config or MergingConfig(), objects or ObjectConfig()
    if len(drives) < 2:
        raise MapError(f"{len(drives)} drive: merging needs two runs or more")
    # Which drives show the same street
    linking = link_drives(drives, config, progress)
    worlds, contradicting = list[World](), list[str]()
    for component in linking.components:
        # Where each lies, and which cars are one
        laid = lay_component(drives, component, config)
        # One estimate a car: fused, then fitted to the views of all drives
        fused_cars = [FusedCar(p, fused(k, drives, laid, p, config)) for k, p in enumerate(laid.places, 1)]
        if config.use_views:
            fused_cars, said = fitted_together(drives, laid, fused_cars, objects, config, categories or {}, progress)
            contradicting += said
        # What each drive says of each car, and which have moved
        cars = _visited(drives, laid, fused_cars, config, progress)
        kept = told_apart(cars, config)
        worlds.append(World(_laid_drives(drives, laid, config), tuple(_numbered(kept)), laid.variance_factor))
    found = Merged(tuple(drives), tuple(worlds), {}, ())
    notes = (*notes_of(found, linking, config), *linking.conflicts, *contradicting)
    return replace(found, figures=figures_of(found), notes=notes)


def _visited(
    drives: Sequence[Drive],
    laid: LaidComponent,
    fused_cars: Sequence[FusedCar],
    config: MergingConfig,
    progress: Progress | None,
) -> list[MergedCar]:
    found = []
    for k, car in enumerate(fused_cars, 1):
        indices = sorted(laid.aligned.world_from_drive)
        visits = tuple(_visit(drives, laid, index, car.place, car.thing, config) for index in indices)
        found.append(MergedCar(car.thing, visits))
        if progress is not None:
            progress("visits", k, len(fused_cars))
    return found


def _visit(
    drives: Sequence[Drive], laid: LaidComponent, index: int, place: Place, thing: MapObject, config: MergingConfig
) -> Visit:
    """What one drive says of a car in its place."""
    number, drive = place.members.get(index), drives[index]
    if number is None:
        world_from_drive = laid.aligned.world_from_drive[index]
        return visit_without(drive, index, world_from_drive, thing, config.visits, drive.map.objects)
    there = pose_of(drives, laid.aligned, index, number).translation
    apart = float(np.linalg.norm(there - thing.world_from_object.translation))
    return Visit(index, "seen", number, apart, drive.map[number].views)


def _numbered(cars: Sequence[MergedCar]) -> list[MergedCar]:
    """The cars with numbers from 1 on, by the first drive that saw them and their number there."""

    def first(car: MergedCar) -> tuple[int, int]:
        seen = [(visit.drive, visit.number) for visit in car.visits if visit.number is not None]
        return min(seen)

    ordered = sorted(cars, key=first)
    return [replace(car, thing=replace(car.thing, id=k)) for k, car in enumerate(ordered, 1)]


def _laid_drives(drives: Sequence[Drive], laid: LaidComponent, config: MergingConfig) -> tuple[LaidDrive, ...]:
    found = []
    for index, pose in sorted(laid.aligned.world_from_drive.items()):
        keys = [key for key in sorted(laid.laid.residuals) if key[0] == index]
        gaps = np.array([np.linalg.norm(laid.laid.residuals[key][:2]) for key in keys])
        errors = [_lateral_error(laid, drives, key, config) for key in keys]
        covariance = laid.laid.covariance(index, index)
        mean_error = float(np.mean(errors)) if errors else 0.0
        how = _how(laid, index, len(keys), config)
        found.append(LaidDrive(index, pose, covariance, len(keys), gaps, mean_error, how))
    return tuple(found)


def _lateral_error(laid: LaidComponent, drives: Sequence[Drive], key: tuple[int, int], config: MergingConfig) -> float:
    """Squared residual of a car on the ground, in variances, 1 on average: less than a variance is left by the fit."""
    place = laid.places[key[1]]
    count, residual = len(place.members), laid.laid.residuals[key][:2]
    spread = own_covariance(drives[key[0]].map[place.members[key[0]]], config)[:2, :2]
    return float(residual @ np.linalg.solve(spread, residual)) / 2 * count / (count - 1)


def _how(laid: LaidComponent, index: int, shared: int, config: MergingConfig) -> str:
    if len(laid.aligned.world_from_drive) == 1:
        return "alone"
    if index == laid.component.anchor:
        return "world"
    return "given" if config.poses == "global" and not shared else "constellation"
