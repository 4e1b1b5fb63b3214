"""`map`: from a recording with known camera poses to a map."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from meshslam.categories import load_category
from meshslam.evaluation import evaluate_run
from meshslam.mapping import LeftOut, ObjectMapping, map_objects
from meshslam.maps import CameraPath, Map, RunDirectory, Trajectory
from meshslam.perception import DetectionSet
from meshslam.runs import stages
from meshslam.runs.clock import Clock
from meshslam.runs.config import Config
from meshslam.runs.judging import judge_recording, judge_tracks, say
from meshslam.runs.left_out import save_left_out_tracks
from meshslam.runs.logged_run import LoggedRun, log_run_directory
from meshslam.runs.map_notes import heading_notes
from meshslam.runs.outlet import Outlet
from meshslam.runs.perception import follow, perceive
from meshslam.runs.report import save_map_report
from meshslam.sequences import Sequence


@dataclass(frozen=True, eq=False)
class MapResult:
    """What mapping a drive gives.

    `map` holds the objects by their ids, `trajectory` the camera's path, `left_out` the tracks that did not become
    objects and why, `detections` everything that was detected, on its tracks; `figures` are named as in metrics.json.
    """

    map: Map
    trajectory: Trajectory
    left_out: tuple[LeftOut, ...]
    detections: DetectionSet
    figures: dict[str, float]
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Mapped:
    """A drive's map beside the path that it was made along."""

    frames: CameraPath
    mapping: ObjectMapping
    clock: Clock

    def result(self, recording: Sequence, outlet: Outlet) -> MapResult:
        """As a program takes it."""
        path = Trajectory(self.frames.times_s, self.frames.world_from_camera)
        figures, found = stages.figures(recording, self.mapping, self.clock), self.mapping
        return MapResult(found.map, path, found.left_out, found.detections, figures, tuple(outlet.notes))


def map_recording(
    recording: Sequence,
    settings: Config,
    outlet: Outlet,
    run: RunDirectory | None = None,
    clock: Clock | None = None,
) -> Mapped:
    """Perceive, track, place the camera, map."""
    clock, category = clock or Clock(), load_category(settings.input.category)
    recording = prepared(recording, outlet)
    logged = LoggedRun.begin(recording, outlet, recording.world_from_camera)
    with clock.timing("perception"):
        seen = perceive(recording, settings, outlet, run, logged.perceived)
    with clock.timing("tracking"):
        tracked = follow(recording, seen.detections, settings, outlet, run)
    say(judge_tracks(recording, tracked), outlet)
    with clock.timing("mapping"):
        frames = stages.camera_path(recording, tracked, category, settings, outlet)
        logged.placed(tracked, frames.world_from_camera)
        mapping = map_objects(
            frames,
            tracked,
            category,
            settings.objects,
            settings.mapping,
            fixed_tracks=seen.has_given_tracks,
            progress=outlet.progress,
            on_objects=logged.objects if logged.is_on else None,
        )
    mapped = {number: p for number, p in mapping.reversed_probabilities.items() if number in mapping.map}
    for note in heading_notes(mapped):
        outlet.note(note)
    logged.result(mapping.map, Trajectory(frames.times_s, frames.world_from_camera), mapping.detections)
    return Mapped(frames, mapping, clock)


def prepared(recording: Sequence, outlet: Outlet) -> Sequence:
    """What mapping takes of a recording: what cannot be right ends the run before the first image is looked at."""
    recording = recording.with_poses_only()
    stages.need_poses(recording)
    recording, findings = judge_recording(recording, poses=True, imu=False)
    say(findings, outlet)
    return recording


def run_map(
    settings: Config, out: Path, outlet: Outlet, *, overwrite: bool, clock: Clock | None = None
) -> dict[str, float]:
    """Map, save, evaluate, report, into a run directory: what is there already is not done again."""
    with stages.begin("map", settings, out, outlet, overwrite=overwrite) as begun:
        if begun.figures is not None:
            log_run_directory(begun, outlet)
        return begun.figures or _map_into(begun, settings, outlet, clock or Clock())


def _map_into(begun: stages.Begun, settings: Config, outlet: Outlet, clock: Clock) -> dict[str, float]:
    """The same where the run is not there yet."""
    recording, run = begun.recording.with_poses_only(), begun.run
    made = map_recording(recording, settings, outlet, run, clock)
    stages.save(recording, made.frames, made.mapping, run, outlet)
    save_left_out_tracks(made.mapping, run, outlet)
    figures = stages.figures(recording, made.mapping, made.clock) | evaluate_run(recording.root, run.folder)
    shown = (recording, made.frames, made.mapping, settings.input.category)
    figures = save_map_report(*shown, figures, run, clock, outlet=outlet)
    return stages.end(begun, figures, outlet)
