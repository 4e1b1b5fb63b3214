"""`slam`: camera path and objects together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from meshslam.categories import load_category
from meshslam.evaluation import evaluate_run
from meshslam.geometry import Bytes
from meshslam.maps import CameraPath, RunDirectory, Trajectory
from meshslam.object_slam import Slam, SlamResult, SlamState, slam_sequence
from meshslam.runs import stages
from meshslam.runs.clock import Clock
from meshslam.runs.config import Config
from meshslam.runs.judging import judge_recording, judge_sight, say
from meshslam.runs.left_out import save_left_out_tracks
from meshslam.runs.live_run import live_recording
from meshslam.runs.logged_run import LoggedRun, log_run_directory
from meshslam.runs.notes import imu_notes, object_notes, scale_notes
from meshslam.runs.outlet import Outlet
from meshslam.runs.perception import follow, perceive
from meshslam.runs.report import save_map_report
from meshslam.runs.truth import paths_against_truth
from meshslam.sequences import Sequence


def slam_recording(
    recording: Sequence, settings: Config, outlet: Outlet, clock: Clock, run: RunDirectory | None = None
) -> SlamResult:
    """Perceive, track, estimate path and objects together."""
    category, recording = load_category(settings.input.category), prepared(recording, settings, outlet)
    logged = LoggedRun.begin(recording, outlet)
    with clock.timing("perception"):
        seen = perceive(recording, settings, outlet, run, logged.perceived)
    say([] if by_odometry(settings) else judge_sight(recording, seen.detections), outlet)
    notes = imu_notes(recording, settings.estimation.imu)
    notes += [] if by_odometry(settings) else scale_notes(recording)
    for note in notes + object_notes(recording, seen.detections):
        outlet.note(note)
    with clock.timing("tracking"):
        tracked = follow(without_poses(recording, settings), seen.detections, settings, outlet, run)
    by_frame = tracked.by_frame()

    def on_state(state: SlamState, image: Bytes | None, slam: Slam) -> None:
        at = (state.frame, state.world_from_camera, state.camera_covariance, by_frame.get(state.frame, ()))
        objects = slam.map(covariances=logged.wants_sigmas).objects
        logged.estimated(*at, image=image, objects=objects, stage="slam")

    with clock.timing("localization"):
        result = slam_sequence(
            recording,
            tracked,
            category,
            settings,
            outlet.progress,
            fixed_tracks=seen.has_given_tracks,
            on_state=on_state if logged.is_on else None,
        )
    logged.result(result.map, result.trajectory, result.detections, result.estimate, result.world_from_graph)
    clock.move("localization", "mapping", result.refinement_s)
    for note in result.notes:
        outlet.note(note)
    return result


def prepared(recording: Sequence, settings: Config, outlet: Outlet) -> Sequence:
    """What SLAM takes of a recording: what cannot be right ends the run before the first image is looked at."""
    odometry = by_odometry(settings)
    recording, findings = judge_recording(recording, poses=odometry, imu=not odometry)
    say(findings, outlet)
    return recording


def without_poses(recording: Sequence, settings: Config) -> Sequence:
    """Known poses beyond the first are not for SLAM, unless they are its odometry."""
    return recording if by_odometry(settings) else replace(recording, world_from_camera=None)


def by_odometry(settings: Config) -> bool:
    """Whether the recording's poses are the odometry."""
    return settings.slam.poses == "odometry"


def run_slam(
    settings: Config, out: Path, outlet: Outlet, *, overwrite: bool, clock: Clock | None = None
) -> dict[str, float]:
    """SLAM, save, evaluate, report, into a run directory: what is there already is not done again."""
    with stages.begin("slam", settings, out, outlet, overwrite=overwrite) as begun:
        if begun.figures is not None:
            log_run_directory(begun, outlet)
        return begun.figures or _slam_into(begun, settings, outlet, clock or Clock())


def _slam_into(begun: stages.Begun, settings: Config, outlet: Outlet, clock: Clock) -> dict[str, float]:
    """The same where the run is not there yet."""
    recording, run = begun.recording, begun.run
    live: dict[str, float] = {}
    if settings.live.enabled:
        found = live_recording(recording, settings, outlet, clock)
        recording, result, live, told = found.recording, found.result, found.figures, {"live": found.live_path}
    else:
        result = slam_recording(recording, settings, outlet, clock, run)
        told = {"filtered": Trajectory(recording.times_s, result.filtered)}
    path, height = result.trajectory, recording.height_above_ground_m
    frames = CameraPath(recording.camera, recording.frame_ids, path.times_s, path.world_from_camera, height)
    stages.save(recording, frames, result.mapping, run, outlet)
    sigmas = stages.save_estimate(result.estimate, run, outlet)
    save_left_out_tracks(result.mapping, run, outlet)
    figures = stages.figures(recording, result.mapping, clock) | result.figures | live | sigmas
    figures |= evaluate_run(recording.root, run.folder)
    alone = {"initial": result.alone} if result.alone else {}
    by_iteration = {f"iteration_{k:02d}": poses for k, poses in enumerate(result.iterations)}
    figures |= paths_against_truth(recording, {**alone, **told, **by_iteration})
    drawn = {result.alone_by: result.alone} if result.alone else {}
    shown = (recording, frames, result.mapping, settings.input.category)
    figures = save_map_report(*shown, figures, run, clock, drawn, result.estimate, outlet=outlet)
    return stages.end(begun, figures, outlet)
