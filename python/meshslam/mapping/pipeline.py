"""From tracked detections and camera poses to a map of objects (paper, Sec. IV)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Floats, ObjectState, Pose
from meshslam.mapping.common_shape import about, common_shape, scene_about, shape_evidence
from meshslam.mapping.config import MappingConfig
from meshslam.mapping.finished import Finished, finished, mean_ious
from meshslam.mapping.joining import join_tracks
from meshslam.mapping.judgement import motion_of, why_unfit, without_duplicates
from meshslam.mapping.left_out import LeftOut
from meshslam.mapping.moving import map_moving
from meshslam.mapping.seen_again import same_place, seen_again
from meshslam.mapping.selection import usable_tracks
from meshslam.mapping.work import HeldViews, Progress, Work, by_gradient, each, first_pass, fit_again, next_pass
from meshslam.maps import CameraPath, Map, MapObject
from meshslam.moving import ShapeEvidence
from meshslam.objects import (
    ObjectConfig,
    Occluders,
    Placed,
    Reconstruction,
    Scene,
    Track,
    category_model,
    centred,
    estimated_noise,
    fit_free_form,
    road_points,
)
from meshslam.perception import DetectionSet

_DEFAULT_CAMERA_HEIGHT_M = 1.65
NOISE_TRACKS = 500


@dataclass(frozen=True, eq=False)
class Stages:
    """Vertices and pose of an object after each step, for figures and pictures."""

    start: ObjectState
    posed: ObjectState
    modes: ObjectState
    shaped: ObjectState


@dataclass(frozen=True, eq=False)
class ObjectMapping:
    """What mapping found."""

    map: Map
    detections: DetectionSet  # with the tracks that joined removed
    left_out: tuple[LeftOut, ...]
    stages: dict[int, Stages]  # by object
    mask_ious: dict[str, float]  # the figures of metrics.json
    tracked: DetectionSet  # with the tracks as they were given
    reversed_probabilities: dict[int, float] = field(default_factory=dict)  # by object: that it faces the other way


def map_objects(
    frames: CameraPath,
    detections: DetectionSet,
    category: Category,
    objects: ObjectConfig,
    config: MappingConfig,
    *,
    starts: Mapping[int, Pose] | None = None,
    fixed_tracks: bool = False,
    progress: Progress | None = None,
    on_objects: Callable[[list[MapObject]], None] | None = None,
) -> ObjectMapping:
    """Estimate pose and shape of every parked object of `category` that the tracks show.

    `starts`: where objects of some tracks are known to stand, so that no start is searched for. `fixed_tracks`: track
    ids were given, so that no two are joined. Objects that move, are seen too little or do not
    fit their masks are left out, with the reason. `on_objects` is called with all objects as they are known, after each
    object of the first pass and after each further pass.
    """
    tracked, scene = detections, make_scene(frames, detections, category, objects, use_ground=config.use_ground)
    tracks, left_out = usable_tracks(frames, detections, category.name, config, objects.min_view_box_px)

    so_far = _SoFar(scene)

    def tell(work: list[Work]) -> None:
        if on_objects is not None:
            on_objects([so_far.object_of(w) for w in work])

    held = HeldViews.of(tracks, scene)
    occluders, known = Occluders(frames.camera, detections.by_frame(), frames.pose_of_frame()), starts or {}
    if objects.solver == "gradient":
        work = each("descend", lambda t: held.settled(by_gradient(t, scene, occluders)), tracks, progress, tell)
        ended = each("uncertainty", lambda w: finished(w.with_views(scene), scene, config), work, progress)
        return _mapping(ended, left_out, detections, tracked, scene, config)

    # each object goes through a whole sweep at once, so that its views are made once and need not be kept
    work, scene = _begun(tracks, scene, occluders, known, config, held, progress, tell)
    work, mu, gone = _fitted(work, scene, occluders, config, held, progress)
    if mu is not None:
        scene = scene_about(scene, mu)
        so_far = _SoFar(scene)
    left_out += gone
    detections, work, gone = join_tracks(work, detections, scene, occluders, config, fixed_tracks=fixed_tracks)
    left_out += gone
    work = [held.settled(w) for w in work]
    tell(work)

    for number in range(1, config.passes - 1):
        placed = occluders.with_placed(_placed(work, scene))
        again = partial(next_pass, scene=scene, earlier=occluders, occluders=placed)
        work, occluders = each(f"refine {number}", held.passing(again), work, progress), placed
        tell(work)
    placed = occluders.with_placed(_placed(work, scene))

    def last(work: Work) -> Finished:
        again = work.with_views(scene) if config.passes < 2 else next_pass(work, scene, occluders, placed)
        shaped = replace(again, found=fit_free_form(again.observed, scene, again.found))
        return finished(shaped, scene, config)

    ended = each("shape", last, work, progress)
    tell([one.work for one in ended])
    mapping = _mapping(ended, left_out, detections, tracked, scene, config, mu)
    if not fixed_tracks:
        mapping = _with_tracks_seen_again(mapping, frames)
    return _with_moving(mapping, tracks, ended, scene, placed, config, progress)


def _begun(
    tracks: list[Track],
    scene: Scene,
    occluders: Occluders,
    known: Mapping[int, Pose],
    config: MappingConfig,
    held: HeldViews,
    progress: Progress | None,
    tell: Callable[[list[Work]], None],
) -> tuple[list[Work], Scene]:
    """Start, pose and modes of every track, and the scene with the noise that these fits leave over."""
    asked = noise_tracks(tracks) if config.estimate_noise else frozenset()
    left_over: dict[int, list[Floats]] = {}

    def begin(track: Track) -> Work:
        work = first_pass(track, scene, occluders, known.get(track.id))
        if track.id in asked:
            left_over[track.id] = border_distances_px(work, scene)
        return held.settled(work)

    work = each("initialize", begin, tracks, progress, tell)
    distances = [row for w in work for row in left_over.get(w.observed.track.id, [])]
    return work, with_noise_of(scene, distances) if config.estimate_noise else scene


def _fitted(
    work: list[Work],
    scene: Scene,
    occluders: Occluders,
    config: MappingConfig,
    held: HeldViews,
    progress: Progress | None,
) -> tuple[list[Work], Floats | None, list[LeftOut]]:
    """Fitted with the noise known; what is no parked object is left out, but for its shape.

    Until places are known, masks alone tell what hides an object. What seems unfit then is fitted and judged again by
    the places of all. The last sweep may mend its shape. Shapes are counted from the drive's common shape `mu` then.
    """
    lenient_scene, lenient = _lenient(scene, config)

    def fit(work: Work) -> _Fitted:
        again = fit_again(work.with_views(scene), scene)
        moved = motion_of(again, scene)
        unfit = why_unfit(again, scene, config, judge_shape=False, moved=moved)
        if unfit is None:
            return _Fitted(held.settled(again), shape_evidence(again, scene))
        hopeless = why_unfit(again, lenient_scene, lenient, judge_shape=False, moved=moved)
        return _Fitted(held.settled(again), None, unfit, hopeless is None)

    rows = each("fit", fit, work, progress)
    mu = common_shape([row.evidence for row in rows if row.evidence is not None], config.common_shape_sigma)
    if mu is not None:
        rows = [replace(row, work=about(row.work, mu)) for row in rows]
        scene = scene_about(scene, mu)
    placed = occluders.with_placed(_placed([row.work for row in rows if row.is_candidate], scene))

    def judge(row: _Fitted) -> tuple[Work, LeftOut | None]:
        again = next_pass(row.work.with_views(scene), scene, occluders, placed)
        return held.settled(again), why_unfit(again, scene, config, judge_shape=False)

    doubtful = [row for row in rows if row.unfit is not None and row.is_candidate]
    judged = dict(zip(doubtful, each("judge", judge, doubtful, progress), strict=True))
    ended = [judged.get(row, (row.work, row.unfit)) for row in rows]
    return [w for w, unfit in ended if unfit is None], mu, [unfit for _, unfit in ended if unfit is not None]


@dataclass(frozen=True, eq=False)
class _Fitted:
    """An object after its first fit."""

    work: Work
    evidence: ShapeEvidence | None
    unfit: LeftOut | None = None
    is_candidate: bool = True  # for the map, when more is known of what hides it


def _lenient(scene: Scene, config: MappingConfig) -> tuple[Scene, MappingConfig]:
    """What objects are judged by while others may hide them unknown: by masks half as strict, motion a quarter."""
    motion = replace(scene.config, motion_gain=4 * scene.config.motion_gain)
    return replace(scene, config=motion), replace(config, min_mask_iou=config.min_mask_iou / 2)


def _mapping(
    ended: list[Finished],
    left_out: list[LeftOut],
    detections: DetectionSet,
    tracked: DetectionSet,
    scene: Scene,
    config: MappingConfig,
    mu: Floats | None = None,
) -> ObjectMapping:
    """What fits and stands in a place of its own, with its uncertainty."""
    unfit = [one.unfit for one in ended if one.unfit is not None]
    work, doubled = without_duplicates([one.work for one in ended if one.unfit is None], scene, config)
    kept = {w.observed.track.id for w in work}
    done = [one for one in ended if one.unfit is None and one.work.observed.track.id in kept]
    objects = tuple(one.object for one in done if one.object is not None)
    by_category = work if mu is None else [about(w, -mu) for w in work]
    found = {w.observed.track.id: w.found for w in by_category}
    stages = {number: Stages(f.start, f.posed, f.modes, f.state) for number, f in found.items()}
    reasons = tuple(sorted(left_out + unfit + doubled, key=lambda r: r.track))
    doubts = {one.object.id: one.reversed_probability for one in done if one.object is not None}
    told = {number: doubt for number, doubt in doubts.items() if doubt is not None}
    return ObjectMapping(Map(objects), detections, reasons, stages, mean_ious(done), tracked, told)


def _with_tracks_seen_again(found: ObjectMapping, frames: CameraPath) -> ObjectMapping:
    """The map without objects that are others seen again, and tracks without an object on those that they show."""
    detections, gone = same_place(found.map.objects, found.detections, frames)
    objects = tuple(thing for thing in found.map.objects if thing.id not in gone)
    detections, left_out = seen_again(objects, detections, found.left_out, frames)
    left_out = sorted([*left_out, *gone.values()], key=lambda row: row.track)
    stages = {number: stage for number, stage in found.stages.items() if number not in gone}
    return replace(found, map=Map(objects), detections=detections, left_out=tuple(left_out), stages=stages)


def _with_moving(
    mapping: ObjectMapping,
    tracks: list[Track],
    ended: list[Finished],
    scene: Scene,
    occluders: Occluders,
    config: MappingConfig,
    progress: Progress | None,
) -> ObjectMapping:
    """What drives, apart from what stands."""
    found = map_moving(mapping.left_out, tracks, ended, scene, occluders, config, progress)
    ids = {thing.id for thing in found.objects}
    stands = tuple(thing for thing in mapping.map.objects if thing.id not in ids)
    stages = {number: steps for number, steps in mapping.stages.items() if number not in ids}
    return replace(mapping, map=Map(stands, found.objects), stages=stages, left_out=found.left_out)


def make_scene(
    frames: CameraPath, detections: DetectionSet, category: Category, config: ObjectConfig, *, use_ground: bool = True
) -> Scene:
    """Gather what all objects of a category share."""
    model = category_model(category)
    height = frames.height_above_ground_m or _DEFAULT_CAMERA_HEIGHT_M
    road = road_points(frames.world_from_camera, height) if use_ground else None
    return Scene(frames.camera, category, model, detections.keypoint_names(category.name), road, config)


def noise_tracks(tracks: list[Track]) -> frozenset[int]:
    """The tracks whose masks tell the noise: all of them, or some hundreds spread over a long drive."""
    chosen = np.unique(np.linspace(0, len(tracks) - 1, min(len(tracks), NOISE_TRACKS)).round().astype(int))
    return frozenset(tracks[i].id for i in chosen.tolist())


def border_distances_px(work: Work, scene: Scene) -> list[Floats]:
    """What the first fit of an object leaves over at its masks' borders."""
    views, step = work.observed.views, scene.config.noise.outline_step_px
    return list(scene.model.border_distances_px(views, work.found.state, step))


def with_noise_of(scene: Scene, distances_px: list[Floats]) -> Scene:
    """The scene with the noise of its masks' borders, from what the first fits leave over."""
    config = scene.config
    noise = estimated_noise(distances_px, config.border_step_px, config.noise)
    return replace(scene, config=replace(config, noise=noise))


def _placed(work: list[Work], scene: Scene) -> dict[int, Placed]:
    faces = scene.model.faces
    return {
        w.observed.track.id: Placed(w.found.state.world_from_object, scene.model.vertices(w.found.state), faces)
        for w in work
    }


@dataclass
class _SoFar:
    """Objects that are not finished, as the log shows them: made once for each estimate."""

    scene: Scene
    _known: dict[int, tuple[Reconstruction, MapObject]] = field(default_factory=dict)  # by track

    def object_of(self, work: Work) -> MapObject:
        """Pose and mesh of an object; of their uncertainty nothing is known yet."""
        number, found = work.observed.track.id, work.found
        if number not in self._known or self._known[number][0] is not found:
            mesh, faces = centred(self.scene.model, found.state), self.scene.model.faces
            thing = MapObject(number, self.scene.category.name, mesh.world_from_object, mesh.vertices, faces)
            self._known[number] = found, thing
        return self._known[number][1]
