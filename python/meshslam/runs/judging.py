"""The judgements of a recording that a run makes at its start, and that `check` lists."""

from __future__ import annotations

from dataclasses import replace

from meshslam.perception import DetectionSet
from meshslam.plausibility import (
    FRAME_STEP_S,
    Finding,
    clean_imu,
    judge_camera,
    judge_mounting,
    judge_poses,
    judge_scale,
    judge_times,
    notes,
    raise_errors,
)
from meshslam.runs.outlet import Outlet
from meshslam.sequences import Sequence

HEIGHT_M = {"car": 1.5, "truck": 2.8, "bus": 3.0}  # of usual ones


def judge_recording(recording: Sequence, *, poses: bool, imu: bool) -> tuple[Sequence, list[Finding]]:
    """The recording with its IMU's broken samples left out, and what was found of the parts that a run uses."""
    found = judge_times(recording.times_s, "frames", source_of(recording, "times.txt"), FRAME_STEP_S)
    found += judge_camera(recording.camera, source_of(recording, "camera.yaml"))
    if poses and recording.world_from_camera is not None:
        found += judge_poses(recording.world_from_camera, source_of(recording, "poses.tum"))
    if not imu or recording.imu is None:
        return recording, found
    clean = clean_imu(recording.imu, source_of(recording, "imu.csv"))
    recording, found = replace(recording, imu=clean.samples), [*found, *clean.findings]
    if recording.imu_from_camera is not None and not any(f.severity == "error" for f in clean.findings):
        source = source_of(recording, "camera.yaml")
        found += judge_mounting(recording, clean.samples, recording.imu_from_camera, source)
    return recording, found


def judge_tracks(recording: Sequence, tracked: DetectionSet) -> list[Finding]:
    """Whether known poses and detections have one unit of length."""
    if recording.world_from_camera is None:
        return []
    poses = dict(zip(recording.frame_ids, recording.world_from_camera, strict=True))
    source = source_of(recording, "poses.tum")
    return judge_scale(recording.camera, poses, tracked.by_track(), HEIGHT_M, source)


def say(findings: list[Finding], outlet: Outlet) -> None:
    """Tell the notes; SequenceError with the first error."""
    for finding in notes(findings):
        outlet.note(finding.message)
    raise_errors(findings)


def source_of(recording: Sequence, name: str) -> str:
    """What a file of the recording is called in messages."""
    file = recording.root / name
    return str(file if recording.layout == "folder" and file.is_file() else recording.root)
