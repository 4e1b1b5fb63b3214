"""A finished run, told to a log."""

from __future__ import annotations

from meshslam.exporting.finished_run import FinishedRun
from meshslam.exporting.formats import Notes
from meshslam.perception import DetectionSet
from meshslam.viewing import ReportContext, RunLog, log_finished_run


def log_run(run: FinishedRun, log: RunLog) -> Notes:
    """Tell map, path and each frame, then close the log."""
    context = ReportContext(
        title=run.name,
        camera=run.camera,
        frame_ids=run.frame_ids,
        world_from_camera=run.path.world_from_camera,
        times_s=run.path.times_s,
        detections=run.detections or DetectionSet((), (), ()),
        map=run.scene,
        read_image=run.read_image,
        covariances=None if run.estimate is None else run.estimate.covariances,
    )
    try:
        log.begin(run.name, run.camera)
        log_finished_run(log, context)
    finally:
        log.close()
    return ()
