"""Objects in progress, and the passes of mapping that refine them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import TypeVar

from meshslam.geometry import ObjectState, Pose, View
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
    view_bytes,
    with_surface_error,
    with_surface_sigmas,
)

Given = TypeVar("Given")
Made = TypeVar("Made")
Progress = Callable[[str, int, int], None]  # what is done, how many are done, of how many
HELD_BYTES = 150_000_000  # of views, while all objects are worked on


@dataclass(frozen=True, eq=False)
class Work:
    """An object in progress: its observations, and its estimate so far; its views may have been let go."""

    observed: TrackObservations
    found: Reconstruction
    occluders: Occluders | None = None  # that the views were made with

    def with_views(self, scene: Scene) -> Work:
        """The same with its views: those that were let go are made again, and are what they were."""
        observed = self.observed
        if observed.views or self.occluders is None:
            return self
        views = _all_views(observed.track, scene, self.occluders)
        made = replace(observed, views=views)
        if observed.surface_sigmas_px is not None:
            made = with_surface_sigmas(made, observed.surface_sigmas_px)
        return replace(self, observed=made)

    def without_views(self) -> Work:
        """The same with its views let go."""
        return replace(self, observed=replace(self.observed, views=[], start_views=[]))


@dataclass(frozen=True)
class HeldViews:
    """The tracks whose views are held from pass to pass: memory does not grow with the number of objects.

    A view takes about 0.7 MB, an object has 16. Those of other tracks are made again in each pass.
    """

    tracks: frozenset[int]

    @staticmethod
    def of(tracks: Sequence[Track], scene: Scene, limit_bytes: int | None = None) -> HeldViews:
        """The first tracks, as many as the limit (`HELD_BYTES`) has room for."""
        sizes = accumulate(_view_bytes(track, scene) for track in tracks)
        limit = HELD_BYTES if limit_bytes is None else limit_bytes
        return HeldViews(frozenset(t.id for t, size in zip(tracks, sizes, strict=True) if size <= limit))

    def passing(self, fit: Callable[[Work], Work]) -> Callable[[Work], Work]:
        """One object's part of a sweep: its views go afterwards unless they are held."""
        return lambda work: self.settled(fit(work))

    def settled(self, work: Work) -> Work:
        """The same without its views, unless they are held."""
        return work if work.observed.track.id in self.tracks else work.without_views()


def _view_bytes(track: Track, scene: Scene) -> int:
    config = scene.config
    chosen = track.subset(choose_views(track, config.max_views, config))
    return sum(view_bytes(detection, scene.camera, config) for detection in chosen.detections)


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
    state, views = state or work.found.state, work.with_views(scene).observed.views
    ious = scene.model.mask_ious(views, [state.world_from_object], scene.model.vertices(state))
    return float(ious.mean())


def observe(track: Track, scene: Scene, occluders: Occluders) -> TrackObservations:
    """Choose a track's views and make them."""
    config = scene.config
    chosen = track.subset(choose_views(track, config.max_views, config))
    views = _all_views(chosen, scene, occluders)
    start = choose_views(chosen, config.start_views, config)
    return TrackObservations(chosen, views, chosen.subset(start), [views[i] for i in start])


def _all_views(track: Track, scene: Scene, occluders: Occluders) -> list[View]:
    return make_views(
        track, scene.model, scene.category, scene.keypoint_names, scene.camera, occluders.before, scene.config
    )


def observe_again(
    observed: TrackObservations, scene: Scene, earlier: Occluders, occluders: Occluders
) -> TrackObservations:
    """The same views, those made anew that something else hides now; all of them where they were let go."""
    track, views = observed.track, list(observed.views)
    if not views:
        return replace(observed, views=_all_views(track, scene, occluders))
    changed = [i for i, d in enumerate(track.detections) if earlier.differs(occluders, d)]
    made = make_views(
        track, scene.model, scene.category, scene.keypoint_names, scene.camera, occluders.before, scene.config, changed
    )
    for i, view in zip(changed, made, strict=True):
        views[i] = view
    return replace(observed, views=views)


def first_pass(track: Track, scene: Scene, occluders: Occluders, start: Pose | None = None) -> Work:
    """Start, pose and modes, with occluders that the masks alone tell; a start that is known is not searched for."""
    observed = observe(track, scene, occluders)
    return Work(observed, reconstruct(observed, scene, start), occluders)


def by_gradient(track: Track, scene: Scene, occluders: Occluders) -> Work:
    """The paper's descent instead."""
    observed = observe(track, scene, occluders)
    return Work(observed, reconstruct_by_gradient(observed, scene), occluders)


def next_pass(work: Work, scene: Scene, earlier: Occluders, occluders: Occluders) -> Work:
    """Fit once more, with occluders that the other objects tell."""
    observed = observe_again(work.observed, scene, earlier, occluders)
    observed = with_surface_error(observed, scene, work.found.state)
    return Work(observed, refit(observed, scene, work.found), occluders)


def fit_again(work: Work, scene: Scene) -> Work:
    """Fit with the noise known: from the first fit's end, and anew from its place, in both headings."""
    observed = with_surface_error(work.observed, scene, work.found.state)
    pose = work.found.state.world_from_object
    candidates = [refit(observed, scene, work.found), *fit_modes(observed, scene, [pose, flipped(pose)])]
    best = cheapest(candidates, observed.track)
    return replace(work, observed=observed, found=replace(best, start=work.found.start))
