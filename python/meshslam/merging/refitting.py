"""Cars fitted once more, each to its views of all drives together."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Floats, ObjectState, Pose
from meshslam.maps import MapObject
from meshslam.merging.config import MergingConfig
from meshslam.merging.drives import Drive
from meshslam.merging.joint_views import JointViews, observe, occluders_of, road_of
from meshslam.merging.laying import LaidComponent
from meshslam.merging.links import Progress
from meshslam.merging.places import Place
from meshslam.objects import (
    ObjectConfig,
    Occluders,
    Reconstruction,
    Scene,
    category_model,
    centred,
    cheapest,
    estimated_noise,
    fit_free_form,
    fit_modes,
    flipped,
    refit,
    uncertainty,
)

Given = TypeVar("Given")
Made = TypeVar("Made")
_WORSE = 0.05  # mask IoU by which views together may fit worse than apart, before they contradict each other


@dataclass(frozen=True, eq=False)
class FusedCar:
    """A car with its number in each drive, and its estimate so far; it may also stand where `others` say."""

    place: Place
    thing: MapObject
    others: tuple[Pose, ...] = ()

    @property
    def starts(self) -> tuple[Pose, ...]:
        """Poses that a fit begins with; both headings where the drives do not agree on one."""
        poses = (self.thing.world_from_object, *self.others)
        return (*poses, *map(flipped, poses)) if self.place.turned else poses


@dataclass(frozen=True, eq=False)
class Refitted:
    """A car by all of its views, or the reason why it is not."""

    thing: MapObject | None
    reason: str = ""
    is_conflict: bool = False  # its views contradict each other


@dataclass(frozen=True, eq=False)
class Refitting:
    """What all cars of one category share while they are fitted."""

    drives: Sequence[Drive]
    laid: LaidComponent
    scene: Scene
    occluders: Mapping[int, Occluders]  # by drive
    config: MergingConfig

    def observe(self, place: Place) -> JointViews | None:
        """A car's views."""
        most = max(self.config.min_views, self.config.max_views // max(1, len(place.members)))
        return observe(place, self.drives, self.laid, self.occluders, self.scene, most)

    def with_noise(self, distances_px: Sequence[Floats]) -> Refitting:
        """The same with the noise of these borders."""
        config = self.scene.config
        noise = estimated_noise(distances_px, config.border_step_px, config.noise)
        return replace(self, scene=replace(self.scene, config=replace(config, noise=noise)))


def refitting_of(
    drives: Sequence[Drive], laid: LaidComponent, category: Category, objects: ObjectConfig, config: MergingConfig
) -> Refitting | None:
    """What the cars of a category share; None where no two drives of the component have views."""
    placed = laid.aligned.world_from_drive
    views = {d: v for d in placed if (v := drives[d].views) is not None}
    if len(views) < 2:
        return None
    first = next(iter(views.values()))
    road = np.concatenate([road_of(drives[d], placed[d]) for d in views])
    names = first.detections.keypoint_names(category.name)
    scene = Scene(first.camera, category, category_model(category), names, road, objects)
    return Refitting(drives, laid, scene, {d: occluders_of(drives[d]) for d in views}, config)


def refit_cars(shared: Refitting, cars: Sequence[FusedCar], progress: Progress | None = None) -> list[Refitted]:
    """Fit each car from where it was fused to stand: first for the noise of the masks, then with it."""
    begun = _each("fit together", lambda car: _first_fit(shared, car), cars, progress)
    over = [distances for one in begun if one is not None for distances in one[1]]
    known = shared.with_noise(over)
    pairs = list(zip(cars, begun, strict=True))
    return _each("shape together", lambda pair: _final_fit(known, pair[0], pair[1]), pairs, progress)


def _first_fit(shared: Refitting, car: FusedCar) -> tuple[Reconstruction, tuple[Floats, ...]] | None:
    """A car's first fit, and what its masks' borders leave over; its views are let go."""
    thing = car.thing
    seen, scene = shared.observe(car.place), shared.scene
    if seen is None or len(thing.vertices) != len(scene.category.vertices):
        return None
    found = cheapest(fit_modes(seen.observed, scene, car.starts), seen.observed.track)
    step = scene.config.noise.outline_step_px
    return found, tuple(scene.model.border_distances_px(seen.observed.views, found.state, step))


def _final_fit(shared: Refitting, car: FusedCar, begun: tuple[Reconstruction, tuple[Floats, ...]] | None) -> Refitted:
    thing = car.thing
    seen, scene = shared.observe(car.place), shared.scene
    if seen is None or begun is None:
        return Refitted(None, "fewer than two drives have views of it")
    first = begun[0]
    seen = seen.with_surface_error(scene, shared.drives, first.state.world_from_object)
    tried = [refit(seen.observed, scene, first), *fit_modes(seen.observed, scene, [thing.world_from_object])]
    found = fit_free_form(seen.observed, scene, cheapest(tried, seen.observed.track))
    overlap = _overlap(seen, scene, found.state)
    if thing.mask_iou is not None and overlap < thing.mask_iou - _WORSE:
        figures = f"mask IoU {overlap:.2f}, apart {thing.mask_iou:.2f}"
        return Refitted(None, f"its views of several drives do not agree on one car ({figures})", is_conflict=True)
    return Refitted(_as_object(shared, thing, seen, found, overlap))


def _overlap(seen: JointViews, scene: Scene, state: ObjectState) -> float:
    """Mask IoU of the mesh, mean over the views."""
    vertices = scene.model.vertices(state)
    return float(scene.model.mask_ious(seen.observed.views, [state.world_from_object], vertices).mean())


def _as_object(
    shared: Refitting, thing: MapObject, seen: JointViews, found: Reconstruction, overlap: float
) -> MapObject:
    """The car as the map has it; its pose is as uncertain as its views and as how their drives lie."""
    scene = shared.scene
    mesh = centred(scene.model, found.state)
    covariance, sigma, observed = uncertainty(seen.observed, scene, found)
    points = scene.category.keypoints(mesh.vertices)
    return replace(
        thing,
        world_from_object=mesh.world_from_object,
        vertices=mesh.vertices,
        faces=scene.model.faces,
        views=len(seen.observed.views),
        mask_iou=overlap,
        keypoints=dict(zip(scene.category.keypoint_names, points, strict=True)),
        pose_covariance=covariance + _of_alignment(shared.laid, seen, mesh.world_from_object),
        vertex_sigma_m=sigma,
        vertex_observed=observed,
    )


def _of_alignment(laid: LaidComponent, seen: JointViews, world_from_object: Pose) -> Floats:
    """Covariance (6, 6) of a car's pose from how its drives lie, each drive counting by its share of the views."""
    by_drive = {
        drive: share * (world_from_object.inverse() @ laid.aligned.world_from_drive[drive]).adjoint()
        for drive, share in seen.shares().items()
    }
    total = np.zeros((6, 6))
    for one, left in by_drive.items():
        for other, right in by_drive.items():
            total += left @ laid.laid.covariance(one, other) @ right.T
    return total


def _each(step: str, work: Callable[[Given], Made], items: Sequence[Given], progress: Progress | None) -> list[Made]:
    """Do one thing for every item, side by side; the result's order is the items'."""
    made: list[Made] = []
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        for result in pool.map(work, items):
            made.append(result)
            if progress is not None:
                progress(step, len(made), len(items))
    return made
