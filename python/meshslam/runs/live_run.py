"""`slam --live`: a recording replayed by its clock through the live pipeline."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from meshslam.categories import load_category
from meshslam.errors import ConfigError, MeshslamError, SequenceError
from meshslam.live import LiveCounts, LivePose, LiveSlam, replay
from meshslam.maps import Trajectory
from meshslam.motion import check_imu, start_state
from meshslam.object_slam import SlamResult, path_alone, world_of
from meshslam.perception import DetectionSet, Segmenter, read_recorded_detections, renamings
from meshslam.runs.clock import Clock
from meshslam.runs.config import Config
from meshslam.runs.judging import judge_recording, say
from meshslam.runs.logged_run import LoggedRun
from meshslam.runs.notes import imu_notes
from meshslam.runs.outlet import Outlet
from meshslam.runs.perception import choose_segmenter
from meshslam.sequences import Sequence

_LEAST_SHARE = 0.2  # of frames that the network should reach
_MOST_NOTES = 5
_LATE_S = 0.05  # beyond the deadline
_OBJECTS_STEP_S = 0.5  # in which a log is told the objects


@dataclass(frozen=True, eq=False)
class LiveRun:
    """What a live run found."""

    recording: Sequence  # its frames that have a pose in the end
    result: SlamResult
    live_path: Trajectory  # the poses as they were told, of the frames after the start
    figures: dict[str, float]


def live_recording(recording: Sequence, settings: Config, outlet: Outlet, clock: Clock) -> LiveRun:
    """Replay a recording through `LiveSlam`, then smooth and fit all of it.

    SequenceError where there is no IMU, or where no frame ever had a pose; ConfigError for settings that the live
    pipeline does not know.
    """
    recording = _checked(recording, settings, outlet)
    load_category(settings.input.category)
    given = _given_detections(recording, settings, outlet)
    segmenter: Segmenter | None = None
    if given is None:
        once = replace(settings, segmentation=replace(settings.segmentation, zoom=settings.live.zoom))
        segmenter = choose_segmenter(recording, once, outlet, threads=settings.live.network_threads)
    poses: list[LivePose] = []
    logged, by_frame = LoggedRun.begin(recording, outlet), None if given is None else given.by_frame()

    def on_pose(pose: LivePose) -> None:
        poses.append(pose)
        seen = () if by_frame is None else by_frame.get(pose.frame, ())
        at = (pose.frame, pose.world_from_camera, pose.covariance, seen)
        logged.estimated(*at, stage="latency", milliseconds=1e3 * pose.latency_s)

    assert recording.imu_from_camera is not None
    live = LiveSlam(
        recording.camera,
        imu_from_camera=recording.imu_from_camera,
        category=settings.input.category,
        height_above_ground_m=recording.height_above_ground_m,
        start=recording.initial_state,
        segmenter=segmenter,
        keypoint_names=None if given is None else given.keypoint_names(settings.input.category),
        config=settings,
        live=settings.live,
        on_pose=on_pose,
        source=str(recording.root),
    )
    with clock.timing("live"), live, _objects_told(live, logged):
        replay(recording, live, settings.live.rate, by_frame, outlet.progress)
        live.close()
    notes = [note for pose in poses for note in pose.notes]
    for note in list(dict.fromkeys(notes))[:_MOST_NOTES]:
        outlet.note(note)
    with clock.timing("localization"):
        result = live.finish(partial(world_of, recording, settings), progress=outlet.progress)
    clock.move("localization", "mapping", result.refinement_s)
    for note in (*result.notes, *count_notes(live.counts, settings.live.deadline_s)):
        outlet.note(note)
    alone, name = path_alone(recording, settings, live.first_state, result.world_from_graph)
    result = replace(result, alone=alone, alone_by=name)
    estimate = result.estimate
    assert estimate is not None
    index_of = {number: index for index, number in enumerate(recording.frame_ids)}
    found = [index_of[number] for number in estimate.frame_ids]
    if len(found) < len(recording):
        outlet.note(f"{len(recording) - len(found)} frames before the first one that was taken in have no pose")
        recording, result = recording.part(found), replace(result, alone=tuple(alone[i] for i in found))
    logged = replace(logged, recording=recording)
    logged.result(result.map, result.trajectory, result.detections, result.estimate, result.world_from_graph)
    told = [(pose.time_s, pose.world_from_camera) for pose in poses if pose.world_from_camera is not None]
    world = result.world_from_graph
    path = Trajectory(np.array([time_s for time_s, _ in told]), tuple(world @ pose for _, pose in told))
    return LiveRun(recording, result, path, live.counts.figures)


def _checked(recording: Sequence, settings: Config, outlet: Outlet) -> Sequence:
    if settings.slam.solver != "smoother" or settings.slam.poses != "none":
        raise ConfigError("live: the live pipeline has the solver smoother and the IMU only: leave the other out")
    if recording.imu is None:
        raise SequenceError(f"{recording.root}: live SLAM needs an IMU: imu.csv, oxts, or --imu FILE")
    recording, findings = judge_recording(recording, poses=False, imu=True)
    say(findings, outlet)
    imu, imu_from_camera = check_imu(recording, settings.estimation.imu)
    if recording.initial_state is not None:
        start_state(recording, imu, imu_from_camera)  # says what is wrong with it
    for note in imu_notes(recording, settings.estimation.imu):
        outlet.note(note)
    return recording


@contextmanager
def _objects_told(live: LiveSlam, logged: LoggedRun) -> Iterator[None]:
    """Tell the log what the map is, now and then while the block runs: poses do not wait for it."""
    ended = threading.Event()

    def tell() -> None:
        while not ended.wait(_OBJECTS_STEP_S):
            with suppress(MeshslamError):  # what is wrong with the run, the run itself says
                logged.objects(live.map(covariances=logged.wants_sigmas).objects)

    teller = threading.Thread(target=tell, name="live objects", daemon=True)
    if logged.is_on:
        teller.start()
    try:
        yield
    finally:
        ended.set()
        if logged.is_on:
            teller.join()


def _given_detections(recording: Sequence, settings: Config, outlet: Outlet) -> DetectionSet | None:
    """The recording's own detections, unless a network is named."""
    if settings.input.segmenter is not None or recording.detections_path is None:
        return None
    renamed, tracked = renamings(settings.input.category_names), settings.tracking.categories
    found = read_recorded_detections(recording.detections_path, recording, renamed, tracked)
    for warning in found.warnings:
        outlet.note(warning)
    return found


def count_notes(counts: LiveCounts, deadline_s: float) -> list[str]:
    """What of the counts the user should know."""
    notes: list[str] = []
    if counts.segmented < _LEAST_SHARE * counts.frames:
        notes.append(
            f"live: the network reached {counts.segmented} of {counts.frames} frames only: cars may be missing; a "
            "smaller network or image is faster (docs/networks.md)"
        )
    if counts.taken_in < 0.5 * counts.frames:
        notes.append(
            f"live: the window took in {counts.taken_in} of {counts.frames} frames: this machine is busy, or too slow "
            "for this rate; the other frames' poses follow from the IMU"
        )
    late_s = counts.latency_s(0.95)
    if late_s > deadline_s + _LATE_S:
        notes.append(
            f"live: 5% of the poses came {late_s:.2f} s after their frames or later, not after live.deadline_s, "
            f"{deadline_s:g} s: this machine is busy, or too slow for this rate"
        )
    for count, what in (
        (counts.perceptions_failed, "images or detections could not be used"),
        (counts.too_late, "segmented frames had left the window"),
        (counts.imu_left_out, "IMU samples were left out: no numbers, wild, or there already"),
        (counts.dropped_poses, "poses were not taken in time by the program"),
    ):
        if count:
            notes.append(f"live: {count} {what}")
    if counts.failed:
        notes.append(f"live: {counts.failed} frames could not be taken in, as said above")
    return notes
