"""Where in a map a run starts: by its first objects' places, and by how well the map explains the detections there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from collections.abc import Sequence as Rows
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from meshslam.errors import MapError, SequenceError
from meshslam.geometry import Bools, Camera, Floats, Pose
from meshslam.graph import ObservationCost
from meshslam.initialization import EstimationConfig, Estimator, FirstFrames, rough_start, settled, unknown_start
from meshslam.localization.config import LocalizationConfig
from meshslam.localization.correction import MapObservation, correct
from meshslam.localization.data_association import FrameMasks, associate, in_view, observations_of
from meshslam.localization.local_mapping import MakeLocalMapping, Place, PlaceSearch, moved_state, no_local_mapping
from meshslam.localization.map_models import KnownMap, KnownObject
from meshslam.motion import Mounting, NavState, inertial_path
from meshslam.objects import ObjectConfig
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples

_HEADINGS = 120
_SLACK_M, _SLACK_SHARE = 1.5, 0.12  # by which a rough place may be off, and more for every metre away
_SAME_ID = 0.5  # a track id that is the object's id counts as half an object
_RANKED, _CANDIDATES = 2000, 40  # looked through, and compared with the images
_COMPARED = 5  # frames at a place of a large map
_EXPLAINED = 1.5  # cost of a view, per independent observation, below which it speaks for a candidate
_PLACE_SIGMA_M = 1.0  # of the first camera after that
_APART_M, _APART_RAD = 1.0, 0.1  # candidates nearer than this are one
_SIGMAS = np.array([1.0] * 3 + [np.radians(3.0)] * 3)  # of a candidate, (translation, rotation)


@dataclass(frozen=True, eq=False)
class StartFrame:
    """Detections of one of the first frames, and the camera that took them, in the levelled world."""

    level_from_camera: Pose
    detections: tuple[Detection, ...]


@dataclass(frozen=True, eq=False)
class MapStart:
    """What the first seconds of a recording or stream hold."""

    first: FirstFrames
    imu: ImuSamples
    imu_from_camera: Pose
    detections_of_frame: Mapping[int, tuple[Detection, ...]]
    tracked: Rows[Detection]  # the same detections with tracks
    keypoint_names: Mapping[str, tuple[str, ...]]  # by category, in the order of the detections


def start_in_map(
    given: MapStart,
    known: KnownMap,
    fresh: Callable[[EstimationConfig], Estimator],
    estimation: EstimationConfig,
    config: LocalizationConfig,
    progress: Callable[[str, int, int], None] | None = None,
    make_local: MakeLocalMapping | None = None,
) -> tuple[NavState, EstimationConfig]:
    """The first state in a map, and the settings to begin with it; SequenceError if the map explains nothing.

    In a large map `make_local` maps the first seconds; MapError where it is missing.
    """
    if known.is_large:
        rough = _state_in_large_map(given, known, config, progress, make_local)
    else:
        rough = _state_among_few(given, known.all_of_few(), estimation, config)
    return settled_in_map(given, rough, fresh, estimation, progress)


def settled_in_map(
    given: MapStart,
    rough: NavState,
    fresh: Callable[[EstimationConfig], Estimator],
    estimation: EstimationConfig,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[NavState, EstimationConfig]:
    """The first seconds are run in the map until they settle, and the settings to begin with what they end up with."""
    unknown, speed_m_s = estimation.unknown_start, float(np.linalg.norm(rough.velocity_in_world))
    start = unknown_start(estimation.start, unknown, speed_m_s)
    start = replace(start, position_sigma_m=_PLACE_SIGMA_M, heading_sigma_deg=start.rotation_sigma_deg)
    estimation = replace(estimation, start=start)
    by_frame, lag_s = given.detections_of_frame, estimation.smoother.lag_s
    begin = partial(fresh, estimation)
    reached = settled(given.first, given.imu, by_frame, rough, begin, start, unknown, lag_s, progress)
    return reached.state, estimation


def _state_in_large_map(
    given: MapStart,
    known: KnownMap,
    config: LocalizationConfig,
    progress: Callable[[str, int, int], None] | None,
    make_local: MakeLocalMapping | None,
) -> NavState:
    """The first state by the objects of a map of the first seconds, and by the images there."""
    first, imu = given.first, given.imu
    if make_local is None:
        raise MapError(no_local_mapping(known))
    mapping = make_local(first.camera, given.imu_from_camera, given.keypoint_names, first.source)
    search = PlaceSearch(known, mapping, config.relocalization, progress)
    by_frame: dict[int, list[Detection]] = {}
    for detection in given.tracked:
        by_frame.setdefault(detection.frame, []).append(detection)
    for index, number in enumerate(first.frame_ids):
        time_s = float(first.times_s[index])
        found = search.take(number, time_s, imu if index == 0 else None, tuple(by_frame.get(number, ())))
        if found is not None and (state := explained(given, known, found, config)) is not None:
            return state
        if search.is_over(time_s):
            break
    raise SequenceError(
        f"{first.source}: no start: there is no initial_state.yaml, and the objects of the first "
        f"{time_s - first.times_s[0]:.0f} s are found nowhere among the map's {len(known)}: {search.refused}; another "
        "map, a part of the drive with more parked cars (--from), or give initial_state.yaml"
    )


def explained(given: MapStart, known: KnownMap, place: Place, config: LocalizationConfig) -> NavState | None:
    """The first state at a place, moved to where the images fit; None if the map explains none of them."""
    there, path = place.map_from_local, place.local_from_camera
    seen = {n: _usable(given.detections_of_frame.get(n, ()), config) for n in path}
    shown = [number for number, detections in seen.items() if detections]
    chosen = sorted({shown[k * (len(shown) - 1) // (_COMPARED - 1)] for k in range(_COMPARED)} if shown else ())
    start_frames = [StartFrame(path[number], seen[number]) for number in chosen]
    objects = {o.id: o for number in chosen for o in known.around((there @ path[number]).translation)}
    nearby, names = [objects[number] for number in sorted(objects)], given.keypoint_names
    there, score = _compared(given.first.camera, nearby, there, start_frames, names, config)
    return moved_state(place.first_state, there) if score > 0 else None


def _state_among_few(
    given: MapStart, objects: Rows[KnownObject], estimation: EstimationConfig, config: LocalizationConfig
) -> NavState:
    """The first state by rough places of the first objects, and by the images there."""
    first, imu, unknown = given.first, given.imu, estimation.unknown_start
    # A rough start in a levelled world of its own
    heights = _heights(objects)
    sized = [(d, heights[d.category]) for d in given.tracked if d.category in heights]
    rough = rough_start(first, imu, given.imu_from_camera, sized, estimation.imu, unknown.alignment)
    mounting = Mounting(given.imu_from_camera)
    path = inertial_path(imu, first.times_s[: rough.frames], rough.state, mounting, estimation.imu)
    # That world's place in the map
    chosen = sorted({0, rough.frames // 3, 2 * rough.frames // 3, rough.frames - 1})
    seen = [given.detections_of_frame.get(first.frame_ids[i], ()) for i in chosen]
    start_frames = [StartFrame(path[i], _usable(d, config)) for i, d in zip(chosen, seen, strict=True)]
    found = map_from_level(first.camera, objects, rough.places_m, start_frames, given.keypoint_names, config)
    if found is None:
        raise SequenceError(
            f"{first.source}: no start: there is no initial_state.yaml, and what is seen in the first {rough.frames} "
            f"frames is found nowhere among the map's {len(objects)} objects: another map, or give initial_state.yaml"
        )
    return moved_state(rough.state, found)


def _heights(objects: Rows[KnownObject]) -> dict[str, float]:
    """Median height of each category's objects."""
    found: dict[str, list[float]] = {}
    for thing in objects:
        found.setdefault(thing.category, []).append(float(np.ptp(thing.vertices[:, 2])))
    return {name: float(np.median(heights)) for name, heights in found.items()}


def _usable(detections: tuple[Detection, ...], config: LocalizationConfig) -> tuple[Detection, ...]:
    return tuple(d for d in detections if max(d.bbox[2:]) >= config.min_box_px)


def map_from_level(
    camera: Camera,
    objects: Rows[KnownObject],
    places_m: Mapping[int, Floats],
    start_frames: Rows[StartFrame],
    keypoint_names: Mapping[str, tuple[str, ...]],
    config: LocalizationConfig,
) -> Pose | None:
    """The levelled world's place in the map; None if no candidate explains any detection.

    `places_m` are the rough places of tracked objects in the levelled world.
    """
    best, most = None, 0.0
    for candidate in candidates(objects, places_m):
        pose, score = _compared(camera, objects, candidate, start_frames, keypoint_names, config)
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
    start_frames: Rows[StartFrame],
    keypoint_names: Mapping[str, tuple[str, ...]],
    config: LocalizationConfig,
) -> tuple[Pose, float]:
    """The candidate after a fit to each start frame in turn, and how well it explains the observations."""
    pose, score = map_from_levelled, 0.0
    noise = config.noise.model()
    forgiving = replace(config.association, min_iou=config.association.min_iou_same_id)
    for start_frame in start_frames:
        masks = FrameMasks(camera, start_frame.detections)
        predicted = pose @ start_frame.level_from_camera
        expected = in_view(camera, predicted, objects, config.association.max_distance_m)
        matched = associate(masks, predicted, expected, forgiving)
        views = observations_of(masks, predicted, matched, expected, keypoint_names, ObjectConfig())
        observations = {
            k: MapObservation(ObservationCost(matched[k].model, view, noise, camera.fx), matched[k].world_from_object)
            for k, view in views.items()
        }
        if not observations:
            continue
        found = correct(predicted, np.diag(np.square(_SIGMAS)), observations)
        gain = sum(max(0.0, _EXPLAINED - cost) for cost in found.cost_shares.values())
        score += gain
        if gain > 0:
            pose = _upright(found.world_from_camera @ start_frame.level_from_camera.inverse())
    return pose, score


def _upright(pose: Pose) -> Pose:
    """The pose with only its turn about z."""
    return Pose.from_yaw(float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])), pose.translation)
