"""From tracked detections and camera poses to a map of objects (paper, Sec. IV)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import ObjectState, Pose
from meshslam.mapping.config import MappingConfig
from meshslam.mapping.joining import join_tracks
from meshslam.mapping.judgement import without_duplicates, without_unfit
from meshslam.mapping.left_out import LeftOut
from meshslam.mapping.selection import usable_tracks
from meshslam.mapping.work import (
    HeldViews,
    Progress,
    Work,
    by_gradient,
    each,
    first_pass,
    fit_again,
    mean_iou,
    next_pass,
)
from meshslam.maps import CameraPath, Map, MapObject
from meshslam.objects import (
    ObjectConfig,
    Occluders,
    Placed,
    Scene,
    Track,
    TrackObservations,
    category_model,
    centred,
    estimated_noise,
    fit_free_form,
    fit_modes,
    road_points,
    uncertainty,
)
from meshslam.perception import DetectionSet

_DEFAULT_CAMERA_HEIGHT_M = 1.65


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

    def tell(work: list[Work]) -> None:
        if on_objects is not None:
            on_objects([_object_so_far(w, scene) for w in work])

    held = HeldViews.of(tracks, scene)
    occluders, known = Occluders(frames.camera, detections.by_frame(), frames.pose_of_frame()), starts or {}
    if objects.solver == "gradient":
        work = each("descend", lambda t: held.settled(by_gradient(t, scene, occluders)), tracks, progress, tell)
        return _mapping(work, left_out, detections, tracked, scene, config, progress)

    def begin(track: Track) -> Work:
        return held.settled(first_pass(track, scene, occluders, known.get(track.id)))

    work = each("initialize", begin, tracks, progress, tell)
    scene = with_noise_of(scene, work) if config.estimate_noise else scene
    work = each("fit", held.passing(lambda w: fit_again(w, scene), scene), work, progress)
    work, gone = without_unfit(
        work, scene, config, judge_shape=False
    )  # the next pass knows what hides it, and may mend it
    left_out += gone
    detections, work, gone = join_tracks(work, detections, scene, occluders, config, fixed_tracks=fixed_tracks)
    left_out += gone
    work = [held.settled(w) for w in work]
    tell(work)

    for number in range(1, config.passes):
        placed = Occluders(frames.camera, detections.by_frame(), frames.pose_of_frame(), _placed(work, scene))
        again = partial(next_pass, scene=scene, earlier=occluders, occluders=placed)
        work, occluders = each(f"refine {number}", held.passing(again, scene), work, progress), placed
        tell(work)
    shaped = held.passing(lambda w: replace(w, found=fit_free_form(w.observed, scene, w.found)), scene)
    work = each("shape", shaped, work, progress)
    tell(work)
    return _mapping(work, left_out, detections, tracked, scene, config, progress)


def _mapping(
    work: list[Work],
    left_out: list[LeftOut],
    detections: DetectionSet,
    tracked: DetectionSet,
    scene: Scene,
    config: MappingConfig,
    progress: Progress | None,
) -> ObjectMapping:
    """What fits and stands in a place of its own, with its uncertainty."""
    work, unfit = without_unfit(work, scene, config)
    work, doubled = without_duplicates(work, scene, config)
    left_out = left_out + unfit + doubled
    objects = each("uncertainty", lambda w: _map_object(w.with_views(scene), scene), work, progress)
    stages = {w.observed.track.id: Stages(w.found.start, w.found.posed, w.found.modes, w.found.state) for w in work}
    ious = _stage_ious(work, scene)
    reasons = tuple(sorted(left_out, key=lambda r: r.track))
    return ObjectMapping(Map(tuple(objects)), detections, reasons, stages, ious, tracked)


def make_scene(
    frames: CameraPath, detections: DetectionSet, category: Category, config: ObjectConfig, *, use_ground: bool = True
) -> Scene:
    """Gather what all objects of a category share."""
    model = category_model(category)
    height = frames.height_above_ground_m or _DEFAULT_CAMERA_HEIGHT_M
    road = road_points(frames.world_from_camera, height) if use_ground else None
    return Scene(frames.camera, category, model, detections.keypoint_names(category.name), road, config)


def with_noise_of(scene: Scene, work: list[Work]) -> Scene:
    """The scene with the noise of its masks' borders, from what the first fits leave over."""
    config = scene.config
    step = config.noise.outline_step_px
    over = [
        d
        for w in work
        for d in scene.model.border_distances_px(w.with_views(scene).observed.views, w.found.state, step)
    ]
    noise = estimated_noise(over, config.border_step_px, config.noise)
    return replace(scene, config=replace(config, noise=noise))


def _placed(work: list[Work], scene: Scene) -> dict[int, Placed]:
    faces = scene.model.faces
    return {
        w.observed.track.id: Placed(w.found.state.world_from_object, scene.model.vertices(w.found.state), faces)
        for w in work
    }


def _object_so_far(work: Work, scene: Scene) -> MapObject:
    """Pose and mesh of an object that is not finished; of their uncertainty nothing is known yet."""
    mesh, track = centred(scene.model, work.found.state), work.observed.track
    return MapObject(track.id, scene.category.name, mesh.world_from_object, mesh.vertices, scene.model.faces)


def _map_object(work: Work, scene: Scene) -> MapObject:
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
        mask_iou=mean_iou(work, scene),
        keypoints=dict(zip(scene.category.keypoint_names, keypoints, strict=True)),
        pose_covariance=covariance,
        vertex_sigma_m=sigma,
        vertex_observed=seen,
    )


def _stage_ious(work: list[Work], scene: Scene) -> dict[str, float]:
    """Mask IoU after each step, mean over objects of the mean over their views."""
    if not work:
        return {}
    rows = each("single frame", lambda w: _ious(w.with_views(scene), scene), work, None)
    names = ("mask_iou_single_frame", "mask_iou_category_model", "mask_iou_pose", "mask_iou_shape")
    return {name: float(np.mean(column)) for name, column in zip(names, zip(*rows, strict=True), strict=True)}


def _ious(work: Work, scene: Scene) -> tuple[float, ...]:
    """Mask IoU from one frame alone, and after each step, mean over the views."""
    stages = (work.found.start, work.found.posed, work.found.state)
    return _single_frame_iou(work, scene), *(mean_iou(work, scene, state) for state in stages)


def _single_frame_iou(work: Work, scene: Scene) -> float:
    """Pose and modes from the one frame that shows the object largest, scored on it."""
    sizes = [d.bbox[2] * d.bbox[3] for d in work.observed.track.detections]
    best = [int(np.argmax(sizes))]
    track, views = work.observed.track.subset(best), [work.observed.views[i] for i in best]
    alone = TrackObservations(track, views, track, views)
    [found] = fit_modes(alone, scene, [work.found.start.world_from_object])
    return mean_iou(replace(work, observed=alone), scene, found.state)
