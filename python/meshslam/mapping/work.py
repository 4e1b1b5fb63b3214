"""Objects in progress, and the passes of mapping that refine them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from meshslam.geometry import ObjectState, Pose
from meshslam.objects import (
    Occluders,
    Reconstruction,
    Scene,
    Track,
    TrackObservations,
    cheapest,
    choose_views,
    fit_modes,
    flipped,
    make_views,
    reconstruct,
    reconstruct_by_gradient,
    refit,
    with_surface_error,
)

Given = TypeVar("Given")
Made = TypeVar("Made")
Progress = Callable[[str, int, int], None]  # what is done, how many are done, of how many


@dataclass(frozen=True, eq=False)
class Work:
    """An object in progress: its observations, and its estimate so far."""

    observed: TrackObservations
    found: Reconstruction


def each(
    step: str,
    work: Callable[[Given], Made],
    items: Iterable[Given],
    progress: Progress | None,
    on_made: Callable[[list[Made]], None] | None = None,
) -> list[Made]:
    """Do one thing for every item, side by side; the result's order is the items'.

    `on_made` is called with all results so far whenever there is one more.
    """
    listed = list(items)
    made: list[Made] = []
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        for result in pool.map(work, listed):
            made.append(result)
            if progress is not None:
                progress(step, len(made), len(listed))
            if on_made is not None:
                on_made(made)
    return made


def mean_iou(work: Work, scene: Scene, state: ObjectState | None = None) -> float:
    """Mask IoU of the mesh, mean over its views."""
    state = state or work.found.state
    ious = scene.model.mask_ious(work.observed.views, [state.world_from_object], scene.model.vertices(state))
    return float(ious.mean())


def observe(track: Track, scene: Scene, occluders: Occluders) -> TrackObservations:
    """Choose a track's views and make them."""
    config = scene.config
    chosen = track.subset(choose_views(track, config.max_views, config))
    views = make_views(
        chosen, scene.model, scene.category, scene.keypoint_names, scene.camera, occluders.before, config
    )
    start = choose_views(chosen, config.start_views, config)
    return TrackObservations(chosen, views, chosen.subset(start), [views[i] for i in start])


def observe_again(
    observed: TrackObservations, scene: Scene, earlier: Occluders, occluders: Occluders
) -> TrackObservations:
    """The same views, those made anew that something else hides now."""
    track, views = observed.track, list(observed.views)
    changed = [i for i, d in enumerate(track.detections) if not np.array_equal(earlier.before(d), occluders.before(d))]
    made = make_views(
        track, scene.model, scene.category, scene.keypoint_names, scene.camera, occluders.before, scene.config, changed
    )
    for i, view in zip(changed, made, strict=True):
        views[i] = view
    return replace(observed, views=views)


def first_pass(track: Track, scene: Scene, occluders: Occluders, start: Pose | None = None) -> Work:
    """Start, pose and modes, with occluders that the masks alone tell; a start that is known is not searched for."""
    observed = observe(track, scene, occluders)
    return Work(observed, reconstruct(observed, scene, start))


def by_gradient(track: Track, scene: Scene, occluders: Occluders) -> Work:
    """The paper's descent instead."""
    observed = observe(track, scene, occluders)
    return Work(observed, reconstruct_by_gradient(observed, scene))


def next_pass(work: Work, scene: Scene, earlier: Occluders, occluders: Occluders) -> Work:
    """Fit once more, with occluders that the other objects tell."""
    observed = observe_again(work.observed, scene, earlier, occluders)
    observed = with_surface_error(observed, scene, work.found.state)
    return Work(observed, refit(observed, scene, work.found))


def fit_again(work: Work, scene: Scene) -> Work:
    """Fit with the noise known: from the first fit's end, and anew from its place, in both headings."""
    observed = with_surface_error(work.observed, scene, work.found.state)
    pose = work.found.state.world_from_object
    candidates = [refit(observed, scene, work.found), *fit_modes(observed, scene, [pose, flipped(pose)])]
    best = cheapest(candidates, observed.track)
    return Work(observed, replace(best, start=work.found.start))
