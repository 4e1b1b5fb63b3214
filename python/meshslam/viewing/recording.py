"""A finished run, told to a log: the same for the run directory's recording and for the end of a live one."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from meshslam.geometry import Pose
from meshslam.viewing.context import ReportContext
from meshslam.viewing.rerun_log import RerunLog
from meshslam.viewing.run_log import RunLog


def log_finished_run(log: RunLog, context: ReportContext, world_from_live: Pose | None = None) -> None:
    """Tell map and path, then each frame with its image, its tracked detections and the map's meshes in its view."""
    path, covariances = context.world_from_camera, context.covariances
    log.result(context.map, context.frame_ids, context.times_s, path, covariances, world_from_live)
    for index, (frame, pose) in enumerate(zip(context.frame_ids, path, strict=True)):
        image = None if context.read_image is None else partial(context.read_image, index)
        covariance = None if covariances is None else covariances[index]
        log.frame(frame, float(context.times_s[index]), pose, covariance, image, context.found_at(index))


def write_recording(context: ReportContext, path: Path) -> None:
    """Write a finished run for the Rerun viewer (.rrd); ConfigError if the file cannot be written."""
    log = RerunLog(path, recording_id=context.title)
    try:
        log.begin(context.title, context.camera)
        log_finished_run(log, context)
    finally:
        log.close()
