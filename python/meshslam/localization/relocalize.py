"""Where in a map a run starts: by where its first objects stand, and by what the map would look like from there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from collections.abc import Sequence as Rows
from dataclasses import dataclass, replace

import numpy as np

from meshslam.errors import SequenceError
from meshslam.geometry import Camera, Pose
from meshslam.geometry.arrays import Bools, Floats
from meshslam.localization.config import LocalizationConfig
from meshslam.localization.correction import Sighting, correct
from meshslam.localization.factors import SeenObject
from meshslam.localization.frame_masks import FrameMasks, associate, frame_views, in_view
from meshslam.localization.imu import Mounting, NavState
from meshslam.localization.inertial import inertial_path
from meshslam.localization.known_objects import KnownObject
from meshslam.localization.rough_start import rough_start
from meshslam.localization.start import Estimator, loose, settled
from meshslam.mapping.config import MappingConfig
from meshslam.perception import Detection, DetectionSet, track
from meshslam.sequences import ImuSamples, Sequence, turns

_HEADINGS = 120
_SLACK_M, _SLACK_SHARE = 1.5, 0.12  # by which a rough place may be off, and more for every metre away
_SAME_ID = 0.5  # a track id that is the object's id counts as half an object
_RANKED, _CANDIDATES = 2000, 40  # looked through, and compared with the images
_EXPLAINED = 1.5  # cost of a view, per independent observation, below which it speaks for a candidate
_PLACE_SIGMA_M = 1.0  # of the first camera after that
_APART_M, _APART_RAD = 1.0, 0.1  # candidates nearer than this are one
_SIGMAS = np.array([1.0] * 3 + [np.radians(3.0)] * 3)  # of a candidate, (translation, rotation)


@dataclass(frozen=True, eq=False)
class Look:
    """Detections of one of the first frames, and the camera that took them, in the levelled world."""

    level_from_camera: Pose
    detections: tuple[Detection, ...]


def start_in_map(
    sequence: Sequence,
    imu: ImuSamples,
    detections: DetectionSet,
    objects: Rows[KnownObject],
    fresh: Callable[[LocalizationConfig], Estimator],
    config: LocalizationConfig,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[NavState, LocalizationConfig]:
    """The first state in a map, and the settings to begin with it; SequenceError if the map explains nothing."""
    assert sequence.imu_from_camera is not None
    mounting, tracked = Mounting(sequence.imu_from_camera), track(detections, None, turn=turns(sequence))
    heights = _heights(objects)
    sized = [(d, heights[d.category]) for d in tracked.detections if d.category in heights]
    rough = rough_start(sequence, imu, sequence.imu_from_camera, sized, config.imu, config.alignment)
    path = inertial_path(imu, sequence.times_s[: rough.frames], rough.state, mounting, config.imu)
    by_frame = detections.by_frame()
    found = map_from_level(
        sequence.camera,
        objects,
        rough.places_m,
        [
            Look(path[i], _usable(by_frame.get(sequence.frame_ids[i], ()), config))
            for i in sorted({0, rough.frames // 3, 2 * rough.frames // 3, rough.frames - 1})
        ],
        {c.name: c.keypoints for c in detections.categories},
        config,
    )
    if found is None:
        raise SequenceError(
            f"{sequence.root}: no start: there is no initial_state.yaml, and what is seen in the first {rough.frames} "
            f"frames is found nowhere among the map's {len(objects)} objects: another map, or give initial_state.yaml"
        )
    state = replace(
        rough.state,
        world_from_imu=found @ rough.state.world_from_imu,
        velocity_in_world=found.rotation @ rough.state.velocity_in_world,
    )
    free = loose(config, float(np.linalg.norm(state.velocity_in_world)))
    start = replace(free.start, position_sigma_m=_PLACE_SIGMA_M, heading_sigma_deg=free.start.rotation_sigma_deg)
    free = replace(free, start=start)
    return settled(sequence, imu, detections, state, fresh, free, config.smoother.lag_s, progress), free


def _heights(objects: Rows[KnownObject]) -> dict[str, float]:
    """Median height of each category's objects."""
    found: dict[str, list[float]] = {}
    for thing in objects:
        found.setdefault(thing.category, []).append(float(np.ptp(thing.vertices[:, 2])))
    return {name: float(np.median(heights)) for name, heights in found.items()}


def _usable(detections: tuple[Detection, ...], config: LocalizationConfig) -> tuple[Detection, ...]:
    return tuple(d for d in detections if max(d.bbox[2:]) >= config.minimum_box_px)


def map_from_level(
    camera: Camera,
    objects: Rows[KnownObject],
    places_m: Mapping[int, Floats],
    looks: Rows[Look],
    keypoint_names: Mapping[str, tuple[str, ...]],
    config: LocalizationConfig,
) -> Pose | None:
    """The levelled world's place in the map; None if no candidate explains any detection.

    `places_m` are the rough places of tracked objects in the levelled world.
    """
    best, most = None, 0.0
    for candidate in candidates(objects, places_m):
        pose, score = _compared(camera, objects, candidate, looks, keypoint_names, config)
        if score > most:
            best, most = pose, score
    return best


def candidates(objects: Rows[KnownObject], places_m: Mapping[int, Floats]) -> list[Pose]:
    """Turns about z and shifts that lay many rough places on objects of the map, the best first."""
    tracks = sorted(places_m)
    places = np.array([places_m[t] for t in tracks])
    stand = np.array([o.world_from_object.translation for o in objects])
    slack = _SLACK_M + _SLACK_SHARE * np.linalg.norm(places, axis=1)
    same_id = np.array([[t == o.id for o in objects] for t in tracks])
    found: list[tuple[float, float, float, Floats]] = []
    for yaw in np.arange(_HEADINGS) * 2 * np.pi / _HEADINGS:
        turned = Pose.from_yaw(float(yaw), np.zeros(3)).transform(places)
        for i in range(len(tracks)):
            shifts = stand - turned[i]
            votes, away = _votes(turned[None] + shifts[:, None], stand, slack, same_id)
            found += [(-float(v), float(a), float(yaw), s) for v, a, s in zip(votes, away, shifts, strict=True)]
    found.sort(key=lambda row: row[:2])
    return _spread([Pose.from_yaw(yaw, shift) for _, _, yaw, shift in found[:_RANKED]])


def _votes(moved: Floats, stand: Floats, slack: Floats, same_id: Bools) -> tuple[Floats, Floats]:
    """Of each shift: how many places (S, T, 3) have an object near, and how far these are off in all."""
    gap = np.linalg.norm(moved[:, :, None] - stand[None, None], axis=3) / slack[None, :, None]
    nearest = gap.min(2)
    told = ((gap < 1.0) & same_id[None]).any(2)
    return (nearest < 1.0).sum(1) + _SAME_ID * told.sum(1), np.minimum(nearest, 1.0).sum(1)


def _spread(poses: Rows[Pose]) -> list[Pose]:
    kept: list[Pose] = []
    for pose in poses:
        if len(kept) == _CANDIDATES:
            break
        if all(_differ(pose, other) for other in kept):
            kept.append(pose)
    return kept


def _differ(one: Pose, other: Pose) -> bool:
    turn = np.arccos(np.clip(float(one.rotation[:, 0] @ other.rotation[:, 0]), -1.0, 1.0))
    return float(turn) > _APART_RAD or float(np.linalg.norm(one.translation - other.translation)) > _APART_M


def _compared(
    camera: Camera,
    objects: Rows[KnownObject],
    map_from_levelled: Pose,
    looks: Rows[Look],
    keypoint_names: Mapping[str, tuple[str, ...]],
    config: LocalizationConfig,
) -> tuple[Pose, float]:
    """The candidate after a fit to each look in turn, and how well it explains the views."""
    pose, score = map_from_levelled, 0.0
    noise = replace(config.noise, keypoint_position_sigma_m=config.keypoint_position_sigma_m)
    forgiving = replace(config.association, minimum_iou=config.association.minimum_iou_same_id)
    for look in looks:
        masks = FrameMasks(camera, look.detections)
        predicted = pose @ look.level_from_camera
        expected = in_view(camera, predicted, objects, config.association.largest_distance_m)
        matched = associate(masks, predicted, expected, forgiving)
        views = frame_views(masks, predicted, matched, expected, keypoint_names, MappingConfig())
        sightings = {
            k: Sighting(SeenObject(matched[k].model, view, noise, camera.fx), matched[k].world_from_object)
            for k, view in views.items()
        }
        if not sightings:
            continue
        found = correct(predicted, np.diag(np.square(_SIGMAS)), sightings)
        gain = sum(max(0.0, _EXPLAINED - cost) for cost in found.cost_shares.values())
        score += gain
        if gain > 0:
            pose = _upright(found.world_from_camera @ look.level_from_camera.inverse())
    return pose, score


def _upright(pose: Pose) -> Pose:
    """The pose with only its turn about z."""
    return Pose.from_yaw(float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])), pose.translation)
