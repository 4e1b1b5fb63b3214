"""SLAM on a whole sequence."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from meshslam.categories import Category
from meshslam.errors import SequenceError
from meshslam.geometry import Bytes, Pose
from meshslam.initialization import Path, moved_path, world_from_levelled
from meshslam.mapping import ObjectMapping, map_objects
from meshslam.maps import CameraPath, Trajectory
from meshslam.motion import Mounting, NavState, check_imu, inertial_path, start_state
from meshslam.object_slam.joint_gradient import joint_descent
from meshslam.object_slam.result import SlamResult, SlamState
from meshslam.object_slam.slam import Slam, SlamSettings
from meshslam.object_slam.start import StreamFrame
from meshslam.perception import DetectionSet
from meshslam.sequences import Sequence

Progress = Callable[[str, int, int], None]
OnState = Callable[[SlamState, Bytes | None, Slam], None]  # state, image and run, when a frame was taken in


def slam_sequence(
    sequence: Sequence,
    detections: DetectionSet,
    category: Category,
    settings: SlamSettings,
    progress: Progress | None = None,
    *,
    fixed_tracks: bool = False,
    on_state: OnState | None = None,
) -> SlamResult:
    """Estimate cameras and objects together, frame by frame, then smooth all of it; the detections carry tracks.

    `fixed_tracks`: track ids were given, so that no two are joined. `on_state` is called with each frame that was taken
    in; the solver gradient takes none in but the first ones. SequenceError in clear words where nothing moves the
    camera, or nothing tells how it starts.
    """
    solve = _SOLVERS[settings.slam.solver]
    return solve(_checked(sequence, settings), detections, category, settings, progress, fixed_tracks, on_state)


def _by_smoother(
    sequence: Sequence,
    detections: DetectionSet,
    category: Category,
    settings: SlamSettings,
    progress: Progress | None,
    fixed_tracks: bool,
    on_state: OnState | None,
) -> SlamResult:
    """The stream's estimator, fed with the sequence's frames."""
    slam = _stream(sequence, detections, category, settings)
    for done, _ in enumerate(_fed(slam, sequence, detections, settings, progress, on_state), 1):
        if progress is not None:
            progress("slam", done, len(sequence))
    result = slam.finish(
        detections, partial(world_of, sequence, settings), fixed_tracks=fixed_tracks, progress=progress
    )
    alone, name = path_alone(sequence, settings, slam.first_state, result.world_from_graph)
    return replace(result, alone=alone, alone_by=name)


def _by_gradient(
    sequence: Sequence,
    detections: DetectionSet,
    category: Category,
    settings: SlamSettings,
    progress: Progress | None,
    fixed_tracks: bool,
    on_state: OnState | None,
) -> SlamResult:
    """The paper's joint problem, from odometry alone and the objects that are mapped along it (paper, Sec. IV-D)."""
    if sequence.imu is None and settings.slam.poses != "odometry":
        raise SequenceError(
            f"{sequence.root}: --solver gradient starts from odometry: an IMU (imu.csv, oxts, or --imu FILE) or known "
            "poses (--poses odometry) are needed"
        )
    slam = _stream(sequence, detections, category, settings)
    next(state for state in _fed(slam, sequence, detections, settings, progress, on_state) if state.is_started)
    first, name = path_alone(sequence, settings, slam.first_state, Pose.identity())
    objects = replace(settings.objects, solver="gradient")

    def mapped(path: Path, found: DetectionSet) -> ObjectMapping:
        height = sequence.height_above_ground_m
        frames = CameraPath(sequence.camera, sequence.frame_ids, sequence.times_s, path, height)
        given = (frames, found, category, objects, settings.mapping)
        return map_objects(*given, fixed_tracks=fixed_tracks, progress=progress)

    along, paths = mapped(first, detections), tuple([first])
    if len(along.map):
        weight, count = settings.slam.gradient_keypoint_weight, settings.slam.gradient_iterations
        paths = joint_descent(sequence, along.detections, first, along.map, weight, count, progress)
    world = world_of(sequence, settings, paths[-1][0])
    moved = tuple(moved_path(path, world) for path in paths)
    began_s = time.perf_counter()
    mapping = mapped(moved[-1], along.detections)
    refinement_s = time.perf_counter() - began_s
    figures: dict[str, float] = {"objects_in_graph": len(along.map), "iterations": len(paths) - 1}
    notes = ("map: the objects were fitted once more along the path that the joint descent ended with",)
    trajectory, found = Trajectory(sequence.times_s, moved[-1]), mapping.detections
    return SlamResult(trajectory, moved[-1], mapping, found, figures, notes, refinement_s, world, moved[0], name, moved)


_SOLVERS = {"smoother": _by_smoother, "gradient": _by_gradient}


def _checked(sequence: Sequence, settings: SlamSettings) -> Sequence:
    """The sequence with what moves the camera; SequenceError where nothing does."""
    if settings.slam.poses == "odometry":
        if sequence.world_from_camera is None:
            raise SequenceError(
                f"{sequence.root}: --poses odometry, but no poses are known: poses.tum in a sequence folder, OXTS in "
                "KITTI raw, poses/NN.txt in KITTI odometry"
            )
        return sequence
    if sequence.imu is None and sequence.images is not None:
        return replace(sequence, initial_state=None)  # its velocity is no measure for images alone
    if sequence.imu is None:
        raise SequenceError(
            f"{sequence.root}: nothing tells how the camera moves: there is no IMU (imu.csv, oxts, or --imu FILE), and "
            "there are no images to do without; known poses can be used as odometry (--poses odometry)"
        )
    imu, imu_from_camera = check_imu(sequence, settings.estimation.imu)
    if sequence.initial_state is not None:
        start_state(sequence, imu, imu_from_camera)  # says what is wrong with it
    return sequence


def _stream(sequence: Sequence, detections: DetectionSet, category: Category, settings: SlamSettings) -> Slam:
    return Slam(
        sequence.camera,
        category=category,
        imu_from_camera=sequence.imu_from_camera if sequence.imu is not None else None,
        by_odometry=settings.slam.poses == "odometry",
        height_above_ground_m=sequence.height_above_ground_m,
        start=sequence.initial_state,
        keypoint_names=detections.keypoint_names(category.name),
        config=settings,
        source=str(sequence.root),
    )


def _fed(
    slam: Slam,
    sequence: Sequence,
    detections: DetectionSet,
    settings: SlamSettings,
    progress: Progress | None,
    on_state: OnState | None,
) -> Iterator[SlamState]:
    """Feed the frames in their order; the IMU's samples come with the first."""
    by_frame, poses = detections.by_frame(), sequence.world_from_camera
    by_odometry = settings.slam.poses == "odometry"
    for index, number in enumerate(sequence.frame_ids):
        frame = StreamFrame(number, float(sequence.times_s[index]), by_frame.get(number, ()))
        image = sequence.read_image(index) if sequence.images is not None else None
        odometry = poses[index] if by_odometry and poses is not None else None
        imu = sequence.imu if index == 0 else None
        state = slam.process_tracked(frame, image=image, imu=imu, odometry=odometry, progress=progress)
        if on_state is not None:
            on_state(state, image, slam)
        yield state


def world_of(sequence: Sequence, settings: SlamSettings, first_camera: Pose) -> Pose:
    """The recording's world from the one of the run, whose first pose is given."""
    known_start = sequence.initial_state is not None or settings.slam.poses == "odometry"
    return Pose.identity() if known_start else world_from_levelled(sequence, first_camera)


def path_alone(sequence: Sequence, settings: SlamSettings, start: NavState, world: Pose) -> tuple[Path, str]:
    """The path without objects in the recording's world, and its name; none by images alone."""
    if settings.slam.poses == "odometry":
        return sequence.world_from_camera or (), "odometry alone"
    if sequence.imu is None or sequence.imu_from_camera is None:
        return (), ""
    mounting, config = Mounting(sequence.imu_from_camera), settings.estimation.imu
    return moved_path(inertial_path(sequence.imu, sequence.times_s, start, mounting, config), world), "IMU alone"
