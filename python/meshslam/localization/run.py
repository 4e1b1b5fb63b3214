"""Localization of a whole sequence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from meshslam.categories import Category
from meshslam.errors import SequenceError
from meshslam.geometry import Pose, log_so3
from meshslam.localization.config import LocalizationConfig, SlamConfig
from meshslam.localization.gauge import level_from_world, moved_map, moved_path, moved_sequence
from meshslam.localization.gradient import GradientLocalizer
from meshslam.localization.imu import Mounting, NavState, check_imu
from meshslam.localization.inertial import inertial_path, start_state
from meshslam.localization.joint_gradient import joint_descent
from meshslam.localization.known_objects import known_objects
from meshslam.localization.landmarks import joined_tracks
from meshslam.localization.localizer import FrameReport, Localizer
from meshslam.localization.relocalize import start_in_map
from meshslam.localization.slam import Slam
from meshslam.localization.slam_input import SlamInput, slam_input, slam_start
from meshslam.mapping import Frames, MappingConfig, category_model, map_objects
from meshslam.maps import Map
from meshslam.perception import DetectionSet
from meshslam.sequences import Sequence


@dataclass(frozen=True, eq=False)
class Localization:
    """The camera's path in a map, and how it came about."""

    world_from_camera: tuple[Pose, ...]  # after smoothing
    filtered: tuple[Pose, ...]  # as each was known when its frame came
    inertial: tuple[Pose, ...]  # by the IMU alone
    detections: DetectionSet  # with the map's ids
    moved: dict[int, int]  # objects that were moved since, and the frame that showed it
    figures: dict[str, float]
    iterations: tuple[tuple[Pose, ...], ...] = field(default=())  # gradient solver: the path after each iteration


def localize(
    sequence: Sequence,
    detections: DetectionSet,
    scene: Map,
    config: LocalizationConfig,
    progress: Callable[[str, int, int], None] | None = None,
) -> Localization:
    """Find the camera of every frame in a map; MeshslamError in clear words where the input does not allow it."""
    imu, imu_from_camera = check_imu(sequence, config.imu)
    level = level_from_world(sequence, imu, imu_from_camera)
    sequence, objects = moved_sequence(sequence, level), known_objects(moved_map(scene, level))
    mounting, back = Mounting(imu_from_camera), level.inverse()
    names = {c.name: c.keypoints for c in detections.categories}

    def fresh(settings: LocalizationConfig) -> Localizer:
        return Localizer(sequence.camera, objects, mounting, names, settings)

    if sequence.initial_state is None and sequence.world_from_camera is None:
        start, config = start_in_map(sequence, imu, detections, objects, fresh, config, progress)
    else:
        start = start_state(sequence, imu, imu_from_camera)
    localizer = (
        GradientLocalizer(sequence.camera, objects, mounting, names, config)
        if config.solver == "gradient"
        else fresh(config)
    )
    by_frame = detections.by_frame()
    reports: list[FrameReport] = []
    for index, frame in enumerate(sequence.frame_ids):
        found = by_frame.get(frame, ())
        if index == 0:
            reports.append(localizer.begin(frame, start, imu, found))
        else:
            reports.append(localizer.process(frame, float(sequence.times_s[index]), imu, found))
        if progress is not None:
            progress("localize", index + 1, len(sequence))
    ids: dict[int, int | None] = {d.id: None for d in detections.detections}
    for report in reports:
        ids.update(report.object_of_detection)
    return Localization(
        moved_path(tuple(localizer.path[frame] for frame in sequence.frame_ids), back),
        moved_path(tuple(report.corrected for report in reports), back),
        moved_path(inertial_path(imu, sequence.times_s, start, mounting, config.imu), back),
        detections.with_tracks(ids),
        dict(localizer.moved),
        _figures(localizer, reports, imu_from_camera),
        tuple(moved_path(path, back) for path in _iterations(localizer)),
    )


def _iterations(localizer: GradientLocalizer | Localizer) -> tuple[tuple[Pose, ...], ...]:
    """The path after 0, 1, ... iterations of every frame; a frame that has converged stays. Of the gradient solver."""
    if isinstance(localizer, Localizer):
        return ()
    most = max(len(steps) for steps in localizer.steps.values())
    frames = [localizer.steps[frame] for frame in localizer.path]
    return tuple(tuple(steps[min(k, len(steps) - 1)] for steps in frames) for k in range(most))


def _figures(
    localizer: Localizer | GradientLocalizer, reports: list[FrameReport], imu_from_camera: Pose
) -> dict[str, float]:
    mounting = localizer.current_mounting
    turn = imu_from_camera.rotation.T @ mounting.imu_from_camera.rotation
    return {
        "frames": len(reports),
        "objects_in_map": len(localizer.objects),
        "objects_seen": len({number for report in reports for number in report.object_of_detection.values()}),
        "objects_moved": len(localizer.moved),
        "views_used": sum(len(report.object_of_detection) for report in reports),
        "views_refused": sum(len(report.refused) for report in reports),
        "frames_without_objects": sum(not report.object_of_detection for report in reports),
        "frames_with_imu_gap": sum(report.has_gap for report in reports),
        "imu_time_offset_s": mounting.time_offset_s,
        "imu_from_camera_change_deg": float(np.degrees(np.linalg.norm(log_so3(turn)))),
    }


@dataclass(frozen=True, eq=False)
class SlamPath:
    """The camera's path among objects that were not known before."""

    world_from_camera: tuple[Pose, ...]  # after smoothing over the whole run
    filtered: tuple[Pose, ...]  # as each was known when its frame came
    alone: tuple[Pose, ...]  # without objects: by IMU or odometry; empty by images alone
    alone_by: str  # its name
    detections: DetectionSet  # tracks that show one object are one
    figures: dict[str, float]
    iterations: tuple[tuple[Pose, ...], ...] = ()  # gradient solver: the path after each iteration


def slam_path(
    sequence: Sequence,
    detections: DetectionSet,
    category: Category,
    config: LocalizationConfig,
    slam: SlamConfig,
    mapping: MappingConfig,
    progress: Callable[[str, int, int], None] | None = None,
    *,
    fixed_tracks: bool = False,
) -> SlamPath:
    """Estimate cameras and objects together, frame by frame, then smooth the whole path; the detections carry tracks.

    `fixed_tracks`: track ids were given, so that no two are joined.
    """
    given = slam_input(sequence, detections, config, slam)
    imu, by_frame, model = given.imu, detections.by_frame(), category_model(category)

    def fresh(settings: LocalizationConfig) -> Slam:
        names, height = detections.keypoint_names(category.name), sequence.height_above_ground_m
        known = (sequence.camera, category, model, names, given.mounting, height)
        return Slam(*known, settings, given.slam, mapping, pictures=given.pictures, motion=given.motion)

    start, config = slam_start(given, {category.name: category.dimensions[2]}, fresh, config, progress)
    if config.solver == "gradient":
        return _by_gradient(given, start, category, config, mapping, progress, fixed_tracks=fixed_tracks)
    system, filtered, gaps, without = fresh(config), [], 0, 0
    for index, frame in enumerate(sequence.frame_ids):
        found = by_frame.get(frame, ())
        if index == 0:
            report = system.begin(frame, start, imu, found)
        else:
            report = system.process(frame, float(sequence.times_s[index]), imu, found)
        filtered.append(report.world_from_camera)
        gaps += report.has_gap
        without += not report.objects
        if progress is not None:
            progress("slam", index + 1, len(sequence))
    whole = system.finish()
    one = {} if fixed_tracks else joined_tracks(system.landmarks, whole.same)
    moved = {d.id: one[d.track_id] for d in detections.detections if d.track_id in one}
    figures: dict[str, float] = {
        "objects_in_graph": len(system.landmarks) - len({new for new, _ in whole.same}),
        "objects_known_again": len({new for new, _ in whole.same}),
        "tracks_moving": len(system.moving),
        "frames_with_imu_gap": gaps,
        "frames_without_objects": without,
        # what says how long the way is
        "scale_by_imu": float(given.alone == "IMU alone"),
        "scale_by_odometry": float(given.alone == "odometry alone"),
        "scale_by_objects": float(len(system.landmarks)),
        "scale_by_ways_on_road": float(system.ways_on_road),
    }
    path = whole.world_from_camera
    world = given.world(path[0])
    alone = given.path_alone(start, config, world)
    smoothed, filtered_path = moved_path(path, world), moved_path(tuple(filtered), world)
    return SlamPath(smoothed, filtered_path, alone, given.alone, detections.with_tracks(moved), figures)


def _by_gradient(
    given: SlamInput,
    start: NavState,
    category: Category,
    config: LocalizationConfig,
    mapping: MappingConfig,
    progress: Callable[[str, int, int], None] | None = None,
    *,
    fixed_tracks: bool,
) -> SlamPath:
    """The paper's joint problem, from odometry alone and the objects that are mapped along it."""
    sequence, first = given.sequence, given.path_alone(start, config, Pose.identity())
    if not first:
        raise SequenceError(
            f"{sequence.root}: --solver gradient starts from odometry: an IMU (imu.csv, oxts, or --imu FILE) or known "
            "poses (--poses odometry) are needed"
        )
    height = sequence.height_above_ground_m
    frames = Frames(sequence.camera, sequence.frame_ids, sequence.times_s, first, height)
    by_descent = replace(mapping, solver="gradient")
    found = map_objects(frames, given.detections, category, by_descent, fixed_tracks=fixed_tracks, progress=progress)
    weight, count = config.gradient_keypoint_weight, config.joint_gradient_iterations
    paths: tuple[tuple[Pose, ...], ...] = (first,)
    if len(found.map):
        paths = joint_descent(sequence, found.detections, first, found.map, weight, count, progress)
    world = given.world(paths[-1][0])
    moved = tuple(moved_path(path, world) for path in paths)
    figures: dict[str, float] = {"objects_in_graph": len(found.map), "iterations": len(paths) - 1}
    return SlamPath(moved[-1], moved[-1], moved[0], given.alone, found.detections, figures, moved)
