"""From tracked detections and camera poses to a map of objects (paper, Sec. IV)."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import ObjectModel, ObjectState
from meshslam.mapping.config import LeftOut, MappingConfig
from meshslam.mapping.frames import Frames
from meshslam.mapping.gradient_descent import reconstruct_by_gradient
from meshslam.mapping.ground import road_points
from meshslam.mapping.initialize import flipped
from meshslam.mapping.noise import estimated_noise
from meshslam.mapping.occlusion import Occluders, Placed
from meshslam.mapping.reconstruct import (
    Observed,
    Reconstruction,
    Scene,
    centred,
    cheapest,
    fit_free_form,
    fit_modes,
    height_over_road_m,
    motion,
    reconstruct,
    refit,
    uncertainty,
    with_surface_error,
)
from meshslam.mapping.track import Track, choose_views, make_views
from meshslam.maps import Map, MapObject
from meshslam.perception import Detection, DetectionSet, voted_category

Given = TypeVar("Given")
Made = TypeVar("Made")
Progress = Callable[[str, int, int], None]  # what is done, how many are done, of how many

_DEFAULT_CAMERA_HEIGHT_M = 1.65


@dataclass(frozen=True, eq=False)
class Stages:
    """Vertices and pose of an object after each step, for figures and pictures."""

    start: ObjectState
    posed: ObjectState
    modes: ObjectState
    shaped: ObjectState


@dataclass(frozen=True, eq=False)
class Mapping:
    """What mapping found."""

    map: Map
    detections: DetectionSet  # with the tracks that joined removed
    left_out: tuple[LeftOut, ...]
    stages: dict[int, Stages]  # by object
    mask_ious: dict[str, float]  # the figures of metrics.json


@dataclass(frozen=True, eq=False)
class _Work:
    """An object on its way into the map."""

    observed: Observed
    found: Reconstruction


def map_objects(
    frames: Frames,
    detections: DetectionSet,
    category: Category,
    config: MappingConfig,
    *,
    fixed_tracks: bool = False,
    progress: Progress | None = None,
) -> Mapping:
    """Estimate pose and shape of every parked object of `category` that the tracks show.

    `fixed_tracks`: track ids were given, so that no two are joined. Objects that move, are seen too little or do not
    fit their masks are left out, with the reason.
    """
    scene = make_scene(frames, detections, category, config)
    tracks, left_out = usable_tracks(frames, detections, category.name, config)

    occluders = Occluders(frames.camera, detections.by_frame(), frames.pose_of_frame())
    if config.solver == "gradient":
        work = _each("descend", lambda t: _by_gradient(t, scene, occluders), tracks, progress)
        return _mapping(work, left_out, detections, scene, progress)
    work = _each("initialize", lambda t: _first_pass(t, scene, occluders), tracks, progress)
    scene = with_noise_of(scene, work)
    work = _each("fit", lambda w: _again(w, scene), work, progress)
    work, gone = _without_unfit(work, scene, judge_shape=False)  # the next pass knows what hides it, and may mend it
    left_out += gone
    detections, work, gone = _join(work, detections, scene, occluders, fixed_tracks=fixed_tracks)
    left_out += gone

    for number in range(1, config.passes):
        placed = Occluders(frames.camera, detections.by_frame(), frames.pose_of_frame(), _placed(work, scene))
        again = partial(_next_pass, scene=scene, earlier=occluders, occluders=placed)
        work, occluders = _each(f"refine {number}", again, work, progress), placed
    work = _each("shape", lambda w: _Work(w.observed, fit_free_form(w.observed, scene, w.found)), work, progress)
    return _mapping(work, left_out, detections, scene, progress)


def _mapping(
    work: list[_Work], left_out: list[LeftOut], detections: DetectionSet, scene: Scene, progress: Progress | None
) -> Mapping:
    """What fits and stands in a place of its own, with its uncertainty."""
    work, unfit = _without_unfit(work, scene)
    work, doubled = _without_duplicates(work, scene)
    left_out = left_out + unfit + doubled
    objects = _each("uncertainty", lambda w: _map_object(w, scene), work, progress)
    stages = {w.observed.track.id: Stages(w.found.start, w.found.posed, w.found.modes, w.found.state) for w in work}
    ious = _stage_ious(work, scene)
    return Mapping(Map(tuple(objects)), detections, tuple(sorted(left_out, key=lambda r: r.track)), stages, ious)


def make_scene(frames: Frames, detections: DetectionSet, category: Category, config: MappingConfig) -> Scene:
    """Gather what all objects of a category share."""
    model = category_model(category)
    height = frames.height_above_ground_m or _DEFAULT_CAMERA_HEIGHT_M
    road = road_points(frames.world_from_camera, height) if config.use_ground else None
    return Scene(frames.camera, category, model, detections.keypoint_names(category.name), road, config)


def category_model(category: Category) -> ObjectModel:
    """The observation model of a category's objects."""
    return ObjectModel(
        category.vertices,
        category.faces,
        category.modes,
        category.mirror,
        category.keypoint_weights,
        category.wheel_vertices,
    )


def usable_tracks(
    frames: Frames, detections: DetectionSet, category: str, config: MappingConfig
) -> tuple[list[Track], list[LeftOut]]:
    """Tracks of the category with enough views of enough size, and the others with the reason."""
    at = {frame: i for i, frame in enumerate(frames.frame_ids)}
    needed = min(config.min_views, len(frames.frame_ids))
    tracks, left_out = [], []
    for number, found in detections.by_track().items():
        kind = voted_category(found)
        seen = _one_a_frame([d for d in found if d.frame in at])
        widest = max((d.bbox[2] for d in seen), default=0.0)
        views = sum(d.bbox[2] >= config.view_min_box_px for d in seen)
        if kind != category:
            left_out.append(LeftOut(number, "other category", f"most of its detections say {kind}"))
        elif widest < config.min_box_px:
            left_out.append(LeftOut(number, "too small", f"at most {widest:.0f} px wide"))
        elif views < needed:
            wide = f"at least {config.view_min_box_px:.0f} px wide"
            left_out.append(LeftOut(number, "too few views", f"{views} {wide} of {needed} needed"))
        else:
            index = [at[d.frame] for d in seen]
            poses = tuple(frames.world_from_camera[i] for i in index)
            tracks.append(Track(number, tuple(seen), poses, frames.times_s[index]))
    return tracks, left_out


def _one_a_frame(found: Iterable[Detection]) -> list[Detection]:
    """The largest detection of each frame, by frame."""
    best: dict[int, Detection] = {}
    for d in found:
        if d.frame not in best or d.area_px > best[d.frame].area_px:
            best[d.frame] = d
    return [best[frame] for frame in sorted(best)]


def _each(step: str, work: Callable[[Given], Made], items: Iterable[Given], progress: Progress | None) -> list[Made]:
    """Do one thing for every item, side by side; the result's order is the items'."""
    listed = list(items)
    made: list[Made] = []
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        for result in pool.map(work, listed):
            made.append(result)
            if progress is not None:
                progress(step, len(made), len(listed))
    return made


def observe(track: Track, scene: Scene, occluders: Occluders) -> Observed:
    """Choose a track's views and make them."""
    config = scene.config
    chosen = track.subset(choose_views(track, config.max_views, config))
    views = make_views(
        chosen, scene.model, scene.category, scene.keypoint_names, scene.camera, occluders.before, config
    )
    start = choose_views(chosen, config.start_views, config)
    return Observed(chosen, views, chosen.subset(start), [views[i] for i in start])


def _first_pass(track: Track, scene: Scene, occluders: Occluders) -> _Work:
    observed = observe(track, scene, occluders)
    return _Work(observed, reconstruct(observed, scene))


def _by_gradient(track: Track, scene: Scene, occluders: Occluders) -> _Work:
    observed = observe(track, scene, occluders)
    return _Work(observed, reconstruct_by_gradient(observed, scene))


def observe_again(observed: Observed, scene: Scene, earlier: Occluders, occluders: Occluders) -> Observed:
    """The same views, those made anew that something else hides now."""
    track, views = observed.track, list(observed.views)
    changed = [i for i, d in enumerate(track.detections) if not np.array_equal(earlier.before(d), occluders.before(d))]
    made = make_views(
        track, scene.model, scene.category, scene.keypoint_names, scene.camera, occluders.before, scene.config, changed
    )
    for i, view in zip(changed, made, strict=True):
        views[i] = view
    return replace(observed, views=views)


def _next_pass(work: _Work, scene: Scene, earlier: Occluders, occluders: Occluders) -> _Work:
    observed = observe_again(work.observed, scene, earlier, occluders)
    observed = with_surface_error(observed, scene, work.found.state)
    return _Work(observed, refit(observed, scene, work.found))


def _again(work: _Work, scene: Scene) -> _Work:
    """Fit with the noise known: from where the first fit ended, and anew from its place both ways round."""
    observed = with_surface_error(work.observed, scene, work.found.state)
    pose = work.found.state.world_from_object
    candidates = [refit(observed, scene, work.found), *fit_modes(observed, scene, [pose, flipped(pose)])]
    best = cheapest(candidates, observed.track)
    return _Work(observed, replace(best, start=work.found.start))


def with_noise_of(scene: Scene, work: list[_Work]) -> Scene:
    """The scene with the noise of its masks' borders, from what the first fits leave over."""
    config = scene.config
    if not config.estimate_noise:
        return scene
    step = config.noise.outline_step_px
    over = [d for w in work for d in scene.model.border_distances_px(w.observed.views, w.found.state, step)]
    noise = estimated_noise(over, config.border_step_px, config.noise)
    return replace(scene, config=replace(config, noise=noise))


def _mean_iou(work: _Work, scene: Scene, state: ObjectState | None = None) -> float:
    state = state or work.found.state
    ious = scene.model.mask_ious(work.observed.views, [state.world_from_object], scene.model.vertices(state))
    return float(ious.mean())


def _why_unfit(work: _Work, scene: Scene, *, judge_shape: bool = True) -> LeftOut | None:
    """Why an estimate is no parked object of the category, if it is none."""
    config, track = scene.config, work.observed.track
    distance = min(
        float(np.linalg.norm(pose.translation - work.found.state.world_from_object.translation))
        for pose in track.world_from_camera
    )
    if distance > config.max_distance_m:
        return LeftOut(track.id, "too far", f"{distance:.0f} m at its nearest")
    moving = _moves(work, scene)
    if moving is not None:
        return LeftOut(track.id, "moves", moving)
    height, sigma = height_over_road_m(scene, work.found)
    if abs(height) > max(config.max_height_over_road_m, 4 * sigma):
        return LeftOut(track.id, "not on the road", f"its lowest point is {height:.2f} m over it")
    unlikely = 0.5 * float((work.found.state.z**2).sum())
    if judge_shape and unlikely > config.max_shape_cost:
        return LeftOut(track.id, "no such shape", f"costs {unlikely:.0f} in the category's shape space")
    overlap = _mean_iou(work, scene)
    if overlap < config.min_mask_iou:
        return LeftOut(track.id, "does not fit its masks", f"mean mask IoU {overlap:.2f}")
    return None


def _moves(work: _Work, scene: Scene) -> str | None:
    """The speed, if the views agree far better with an object that drives than with one that stands."""
    if len(work.observed.views) < 3 or np.ptp(work.observed.track.times_s) <= 0:
        return None
    velocity, gain = motion(work.observed, scene, work.found)
    speed = float(np.linalg.norm(velocity[:2]))
    moving = speed > scene.config.max_speed_m_s and gain > scene.config.motion_gain
    return f"its views agree with {speed:.1f} m/s (cost lower by {gain:.0f}), not with one place" if moving else None


def _without_unfit(work: list[_Work], scene: Scene, *, judge_shape: bool = True) -> tuple[list[_Work], list[LeftOut]]:
    reasons = _each("check", lambda w: _why_unfit(w, scene, judge_shape=judge_shape), work, None)
    kept = [w for w, reason in zip(work, reasons, strict=True) if reason is None]
    return kept, [reason for reason in reasons if reason is not None]


def _same_place(work: list[_Work], scene: Scene) -> tuple[int, int] | None:
    """The first two that stand in one place."""
    places = [centred(scene.model, w.found.state).world_from_object.translation for w in work]
    for i, a in enumerate(places):
        for j in range(i + 1, len(places)):
            if float(np.linalg.norm(a - places[j])) < scene.config.merge_distance_m:
                return i, j
    return None


def _join(
    work: list[_Work], detections: DetectionSet, scene: Scene, occluders: Occluders, *, fixed_tracks: bool
) -> tuple[DetectionSet, list[_Work], list[LeftOut]]:
    """Join tracks that turn out to be one object; tracks that were given stay as they are."""
    if fixed_tracks:
        return detections, work, []
    left_out: list[LeftOut] = []
    work = list(work)
    while (pair := _same_place(work, scene)) is not None:
        first, second = (work[i] for i in pair)
        keep, give = (first, second) if len(first.observed.views) >= len(second.observed.views) else (second, first)
        joined, moved = _joined_track(keep, give, detections)
        trial = _first_pass(joined, scene, occluders)
        fits = _mean_iou(trial, scene) > _mean_iou(keep, scene) - 0.05
        if fits:
            detections = detections.with_tracks(moved)
        left_out.append(
            LeftOut(
                give.observed.track.id,
                "the same object",
                f"joined with track {keep.observed.track.id}"
                if fits
                else f"stands where track {keep.observed.track.id} does",
            )
        )
        work = [w for i, w in enumerate(work) if i not in pair] + [trial if fits else keep]
        work.sort(key=lambda w: w.observed.track.id)
    return detections, work, left_out


def _joined_track(keep: _Work, give: _Work, detections: DetectionSet) -> tuple[Track, dict[int, int | None]]:
    """One track of two, and where each detection of the second goes; a frame that both see keeps the first's."""
    a, b = keep.observed.track, give.observed.track
    tracks = detections.by_track()
    taken = {d.frame for d in tracks[a.id]}
    moved: dict[int, int | None] = {d.id: None if d.frame in taken else a.id for d in tracks[b.id]}
    rows = [
        (d.frame, d, p, t)
        for w in (a, b)
        for d, p, t in zip(w.detections, w.world_from_camera, w.times_s, strict=True)
        if w is a or d.frame not in taken
    ]
    rows.sort(key=lambda row: row[0])
    _, seen, poses, times = zip(*rows, strict=True)
    return Track(a.id, tuple(d.with_track(a.id) for d in seen), tuple(poses), np.array(times)), moved


def _without_duplicates(work: list[_Work], scene: Scene) -> tuple[list[_Work], list[LeftOut]]:
    """Of two objects in one place, keep the one that is seen in more views."""
    left_out: list[LeftOut] = []
    while (pair := _same_place(work, scene)) is not None:
        first, second = (work[i] for i in pair)
        give = second if len(first.observed.views) >= len(second.observed.views) else first
        keep = first if give is second else second
        where = f"stands in the place of track {keep.observed.track.id}"
        left_out.append(LeftOut(give.observed.track.id, "the same object", where))
        work = [w for w in work if w is not give]
    return work, left_out


def _placed(work: list[_Work], scene: Scene) -> dict[int, Placed]:
    faces = scene.model.faces
    return {
        w.observed.track.id: Placed(w.found.state.world_from_object, scene.model.vertices(w.found.state), faces)
        for w in work
    }


def _map_object(work: _Work, scene: Scene) -> MapObject:
    track, mesh = work.observed.track, centred(scene.model, work.found.state)
    covariance, sigma, seen = uncertainty(work.observed, scene, work.found)
    keypoints = scene.category.keypoints(mesh.vertices)
    frames = [d.frame for d in track.detections]
    return MapObject(
        id=track.id,
        category=scene.category.name,
        world_from_object=mesh.world_from_object,
        vertices=mesh.vertices,
        faces=scene.model.faces,
        views=len(track.detections),
        first_frame=min(frames),
        last_frame=max(frames),
        mask_iou=_mean_iou(work, scene),
        keypoints=dict(zip(scene.category.keypoint_names, keypoints, strict=True)),
        pose_covariance=covariance,
        vertex_sigma_m=sigma,
        vertex_observed=seen,
    )


def _stage_ious(work: list[_Work], scene: Scene) -> dict[str, float]:
    """Mask IoU after each step, mean over objects of the mean over their views."""
    if not work:
        return {}
    single = _each("single frame", lambda w: _single_frame_iou(w, scene), work, None)
    return {
        "mask_iou_single_frame": float(np.mean(single)),
        "mask_iou_category_model": float(np.mean([_mean_iou(w, scene, w.found.start) for w in work])),
        "mask_iou_pose": float(np.mean([_mean_iou(w, scene, w.found.posed) for w in work])),
        "mask_iou_shape": float(np.mean([_mean_iou(w, scene) for w in work])),
    }


def _single_frame_iou(work: _Work, scene: Scene) -> float:
    """Pose and modes from the one frame that shows the object largest, scored on it."""
    sizes = [d.bbox[2] * d.bbox[3] for d in work.observed.track.detections]
    best = [int(np.argmax(sizes))]
    track, views = work.observed.track.subset(best), [work.observed.views[i] for i in best]
    alone = Observed(track, views, track, views)
    [found] = fit_modes(alone, scene, [work.found.start.world_from_object])
    return _mean_iou(replace(work, observed=alone), scene, found.state)
