"""Localization of a whole sequence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from meshslam.geometry import Floats, Pose, log_so3
from meshslam.initialization import (
    EstimationConfig,
    FirstFrames,
    level_from_world,
    moved_path,
    moved_sequence,
)
from meshslam.localization.config import LocalizationConfig
from meshslam.localization.estimator import FrameReport, LocalizationEstimator, PathEstimate
from meshslam.localization.gradient_estimator import GradientEstimator
from meshslam.localization.local_mapping import MakeLocalMapping
from meshslam.localization.map_models import KnownMap
from meshslam.localization.relocalization import MapStart, start_in_map
from meshslam.maps import Map, TiledMap, Trajectory, TrajectoryEstimate
from meshslam.motion import Mounting, NavState, check_imu, inertial_path, start_state
from meshslam.perception import Detection, DetectionSet, track
from meshslam.sequences import ImuSamples, Sequence, turns


class PathEstimator(Protocol):
    """Finds the camera of one frame after the other in a map."""

    known: KnownMap
    path: dict[int, Pose]
    moved: dict[int, int]

    def begin(self, frame: int, state: NavState, imu: ImuSamples, detections: tuple[Detection, ...]) -> FrameReport:
        """The first frame."""

    def process(self, frame: int, time_s: float, imu: ImuSamples, detections: tuple[Detection, ...]) -> FrameReport:
        """The next frame."""

    @property
    def current_mounting(self) -> Mounting:
        """How the camera is mounted."""

    @property
    def camera_covariance(self) -> Floats | None:
        """Covariance (6, 6) of the newest world_from_camera; None where the solver knows no uncertainty."""

    def estimate(self) -> PathEstimate | None:
        """What is known of each frame beside its pose; None where the solver knows no uncertainty."""

    def paths_by_iteration(self) -> tuple[tuple[Pose, ...], ...]:
        """The path after 0, 1, ... iterations, where the solver has any."""


SOLVERS: dict[str, Callable[..., PathEstimator]] = {"smoother": LocalizationEstimator, "gradient": GradientEstimator}


@dataclass(frozen=True, eq=False)
class LocalizedFrame:
    """A frame as it was localized when it was processed."""

    index: int  # in the sequence
    world_from_camera: Pose  # in the map's world
    covariance: Floats | None  # (6, 6) of it, right perturbation, (translation, rotation), m and rad
    object_of_detection: dict[int, int]  # detections that were used, and the map's object that each shows


@dataclass(frozen=True, eq=False)
class Localization:
    """The camera's path in a map, with the paths that it is compared to."""

    world_from_camera: tuple[Pose, ...]  # after smoothing
    filtered: tuple[Pose, ...]  # as each was estimated when its frame was processed
    inertial: tuple[Pose, ...]  # by the IMU alone
    detections: DetectionSet  # with the map's ids
    moved: dict[int, int]  # objects that were moved since, and the frame that showed it
    figures: dict[str, float]
    refused: dict[int, str]  # why detections were not used, by detection
    iterations: tuple[tuple[Pose, ...], ...] = field(default=())  # gradient solver: the path after each iteration
    estimate: TrajectoryEstimate | None = None  # the path with its uncertainty; None by the gradient solver


def localize_sequence(
    sequence: Sequence,
    detections: DetectionSet,
    scene: Map | TiledMap,
    estimation: EstimationConfig,
    config: LocalizationConfig,
    progress: Callable[[str, int, int], None] | None = None,
    on_frame: Callable[[LocalizedFrame], None] | None = None,
    make_local: MakeLocalMapping | None = None,
) -> Localization:
    """Find the camera of every frame in a map; MeshslamError in clear words where the input does not allow it.

    `on_frame` is called with each frame once it is localized. `make_local` maps the first seconds where a large map is
    given without a start.
    """
    imu, imu_from_camera = check_imu(sequence, estimation.imu)
    level = level_from_world(sequence, imu, imu_from_camera)
    sequence, known = moved_sequence(sequence, level), KnownMap(scene, config.association.max_distance_m, level)
    mounting, back = Mounting(imu_from_camera), level.inverse()
    names, by_frame = {c.name: c.keypoints for c in detections.categories}, detections.by_frame()

    def fresh(settings: EstimationConfig) -> LocalizationEstimator:
        return LocalizationEstimator(sequence.camera, known, mounting, names, settings, config)

    if sequence.initial_state is None and sequence.world_from_camera is None:
        tracked = track(detections, None, turn=turns(sequence)).detections
        given = MapStart(FirstFrames.of(sequence), imu, imu_from_camera, by_frame, tracked, names)
        start, estimation = start_in_map(given, known, fresh, estimation, config, progress, make_local)
    else:
        start = start_state(sequence, imu, imu_from_camera)
    estimator = SOLVERS[config.solver](sequence.camera, known, mounting, names, estimation, config)
    reports: list[FrameReport] = []
    for index, frame in enumerate(sequence.frame_ids):
        found = by_frame.get(frame, ())
        if index == 0:
            reports.append(estimator.begin(frame, start, imu, found))
        else:
            reports.append(estimator.process(frame, float(sequence.times_s[index]), imu, found))
        if progress is not None:
            progress("localize", index + 1, len(sequence))
        if on_frame is not None:
            report, covariance = reports[-1], estimator.camera_covariance
            on_frame(LocalizedFrame(index, back @ report.corrected, covariance, report.object_of_detection))
    ids: dict[int, int | None] = {d.id: None for d in detections.detections}
    for report in reports:
        ids.update(report.object_of_detection)
    path = moved_path(tuple(estimator.path[frame] for frame in sequence.frame_ids), back)
    return Localization(
        path,
        moved_path(tuple(report.corrected for report in reports), back),
        moved_path(inertial_path(imu, sequence.times_s, start, mounting, estimation.imu), back),
        detections.with_tracks(ids),
        dict(estimator.moved),
        _figures(estimator, reports, imu_from_camera),
        {k: reason for report in reports for k, reason in report.reasons.items()},
        tuple(moved_path(path, back) for path in estimator.paths_by_iteration()),
        _estimate(estimator, sequence, path, back),
    )


def _estimate(
    estimator: PathEstimator, sequence: Sequence, path: tuple[Pose, ...], back: Pose
) -> TrajectoryEstimate | None:
    """The path with its uncertainty in the map's world; a right perturbation is the same in any world."""
    found = estimator.estimate()
    if found is None:
        return None
    observed = np.array(found.observed, bool)
    return TrajectoryEstimate(
        Trajectory(sequence.times_s, path),
        tuple(sequence.frame_ids),
        found.covariances,
        found.velocity_in_world @ back.rotation.T,
        found.biases,
        tuple("images" if seen else "imu" for seen in found.observed),
        ~observed,
    )


def _figures(estimator: PathEstimator, reports: list[FrameReport], imu_from_camera: Pose) -> dict[str, float]:
    mounting = estimator.current_mounting
    turn = imu_from_camera.rotation.T @ mounting.imu_from_camera.rotation
    return {
        "frames": len(reports),
        "objects_in_map": len(estimator.known),
        "objects_seen": len({number for report in reports for number in report.object_of_detection.values()}),
        "objects_moved": len(estimator.moved),
        "views_used": sum(len(report.object_of_detection) for report in reports),
        "views_refused": sum(len(report.refused) for report in reports),
        "frames_without_objects": sum(not report.object_of_detection for report in reports),
        "frames_with_imu_gap": sum(report.has_gap for report in reports),
        "imu_time_offset_s": mounting.time_offset_s,
        "imu_from_camera_change_deg": float(np.degrees(np.linalg.norm(log_so3(turn)))),
    }
