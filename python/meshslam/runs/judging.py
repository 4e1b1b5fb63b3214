"""The judgements of a recording that a run makes at its start, and that `check` lists."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from meshslam.errors import DetectionError
from meshslam.maps import Map
from meshslam.perception import DetectionSet, read_recorded_detections, renamings
from meshslam.plausibility import (
    FRAME_STEP_S,
    Finding,
    centres,
    clean_imu,
    errors,
    judge_camera,
    judge_jumps,
    judge_mounting,
    judge_poses,
    judge_rates_by_poses,
    judge_rates_by_sight,
    judge_scale,
    judge_sizes,
    judge_times,
    notes,
    raise_errors,
)
from meshslam.runs.checking import detection_problems
from meshslam.runs.config import InputConfig
from meshslam.runs.opening import recording_options
from meshslam.runs.outlet import Outlet
from meshslam.sequences import Progress, Sequence, inspect_sequence, no_progress

HEIGHT_M = {"car": 1.5, "truck": 2.8, "bus": 3.0}  # of usual ones


def check_recording(chosen: InputConfig, progress: Progress = no_progress) -> list[Finding]:
    """Every problem of a recording, in form and in plausibility, and what reading could handle; runs stop at errors.

    Nothing is estimated, but every image is decoded.
    """
    recording, problems = inspect_sequence(Path(chosen.sequence), replace(recording_options(chosen), progress=progress))
    given = None if chosen.detections is None else Path(chosen.detections)
    problems = [*problems, *detection_problems(Path(chosen.sequence), given, recording, chosen.category_names)]
    found = [Finding("input", str(p), "error" if p.severity == "problem" else "note") for p in problems]
    if recording is None:
        return found
    known = {finding.message for finding in found}
    recording = recording.with_poses_only()
    found += [f for f in judge_recording(recording, poses=True, imu=True)[1] if f.message not in known]
    return (
        found
        if errors(found) or recording.detections_path is None
        else found + _judge_given_tracks(recording, renamings(chosen.category_names))
    )


def _judge_given_tracks(recording: Sequence, renamed: Mapping[str, str]) -> list[Finding]:
    """Of a detection file that says which detections are one object."""
    try:
        file = recording.detections_path
        given = None if file is None else read_recorded_detections(file, recording, renamed)
    except DetectionError:  # what is wrong with its form is said already
        return []
    return [] if given is None else judge_tracks(recording, given) + judge_sight(recording, given)


def judge_recording(recording: Sequence, *, poses: bool, imu: bool) -> tuple[Sequence, list[Finding]]:
    """The recording with its IMU's broken samples left out, and what was found of the parts that a run uses."""
    found = [Finding("input", note, "note") for note in recording.notes]
    found += judge_times(recording.times_s, "frames", source_of(recording, "times.txt"), FRAME_STEP_S)
    found += judge_camera(recording.camera, source_of(recording, "camera.yaml"))
    if poses and recording.world_from_camera is not None:
        source = source_of(recording, "poses.tum")
        judged = judge_poses(recording.world_from_camera, source)
        found += (
            judged if errors(judged) else judged + judge_jumps(recording.times_s, recording.world_from_camera, source)
        )
    if not imu or recording.imu is None:
        return recording, found
    clean = clean_imu(recording.imu, source_of(recording, "imu.csv"))
    recording, found = replace(recording, imu=clean.samples), [*found, *clean.findings]
    if recording.imu_from_camera is not None and not any(f.severity == "error" for f in clean.findings):
        source = source_of(recording, "camera.yaml")
        found += judge_mounting(recording, clean.samples, recording.imu_from_camera, source)
        if poses and recording.world_from_camera is not None and not errors(found):
            given = (recording.times_s, recording.world_from_camera, source_of(recording, "imu.csv"))
            found += judge_rates_by_poses(clean.samples, recording.imu_from_camera, *given)
    return recording, found


def judge_sight(recording: Sequence, seen: DetectionSet) -> list[Finding]:
    """Whether the IMU's rates turn the camera as what it sees says."""
    if recording.imu is None or recording.imu_from_camera is None:
        return []
    by_frame, times_s = seen.by_frame(), recording.times_s.tolist()
    shown = ((t, centres(by_frame.get(n, ()))) for n, t in zip(recording.frame_ids, times_s, strict=True))
    source = source_of(recording, "imu.csv")
    return judge_rates_by_sight(recording.camera, recording.imu, recording.imu_from_camera, shown, source)


def judge_tracks(recording: Sequence, tracked: DetectionSet) -> list[Finding]:
    """Whether known poses and detections have one unit of length."""
    if recording.world_from_camera is None:
        return []
    poses = dict(zip(recording.frame_ids, recording.world_from_camera, strict=True))
    source = source_of(recording, "poses.tum")
    return judge_scale(recording.camera, poses, tracked.by_track(), HEIGHT_M, source)


def judge_map(scene: Map, source: str) -> list[Finding]:
    """Whether a map's objects have the sizes of what they are called."""
    return judge_sizes({f"object {n}": (thing.category, thing.dimensions) for n, thing in scene.items()}, source)


def say(findings: list[Finding], outlet: Outlet) -> None:
    """Tell the notes; SequenceError with the first error."""
    for finding in notes(findings):
        outlet.note(finding.message)
    raise_errors(findings)


def source_of(recording: Sequence, name: str) -> str:
    """What a file of the recording is called in messages."""
    file = recording.root / name
    return str(file if recording.layout == "folder" and file.is_file() else recording.root)
