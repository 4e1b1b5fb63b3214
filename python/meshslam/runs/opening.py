"""The recording that a configuration names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from meshslam.errors import SequenceError
from meshslam.runs.config import InputConfig
from meshslam.sequences import (
    Progress,
    RecordingOptions,
    Sequence,
    no_progress,
    open_with,
    read_selection,
    read_size,
    read_topics,
)


def open_input(
    chosen: InputConfig, *, use_imu: bool = True, kept_index: Path | None = None, progress: Progress = no_progress
) -> Sequence:
    """Open the recording that a run reads; without `use_imu` a sequence folder's IMU is not read.

    `kept_index` is where an earlier run may have left the index of a long recording.
    """
    if not chosen.sequence:
        raise SequenceError("no recording is named: give its folder or file, or input.sequence in the configuration")
    options = replace(recording_options(chosen, use_imu=use_imu), kept_index=kept_index, progress=progress)
    return open_with(Path(chosen.sequence), options)


def recording_options(chosen: InputConfig, *, use_imu: bool = True) -> RecordingOptions:
    """What a configuration chooses about a recording; SequenceError for what cannot be read."""
    return RecordingOptions(
        layout=chosen.layout,
        camera_number=chosen.camera,
        camera_file=_path(chosen.camera_file),
        size=None if chosen.size is None else read_size(chosen.size),
        rate_hz=chosen.rate_hz,
        times_file=_path(chosen.times),
        scene=chosen.scene,
        detections_path=_path(chosen.detections),
        imu=_path(chosen.imu),
        imu_from_camera=_path(chosen.imu_from_camera),
        imu_time_offset_s=chosen.imu_time_offset_s,
        poses=_path(chosen.poses),
        poses_convention=chosen.poses_convention,
        camera_from_body=_path(chosen.camera_from_body),
        poses_time_offset_s=chosen.poses_time_offset_s,
        poses_scale=chosen.poses_scale,
        topics=read_topics(chosen.topics),
        selection=replace(read_selection(chosen.frames), from_s=chosen.from_s, to_s=chosen.to_s),
        use_imu=use_imu,
    )


def _path(text: str | None) -> Path | None:
    return None if text is None else Path(text)
