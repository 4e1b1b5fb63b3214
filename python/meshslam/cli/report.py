"""Puts a run's report together."""

from __future__ import annotations

from meshslam.categories import load_category
from meshslam.geometry import Pose
from meshslam.mapping import Frames, Mapping
from meshslam.maps import RunDirectory
from meshslam.sequences import Sequence
from meshslam.viewing import ReportContext, can_record, write_recording, write_report


def save_report(
    recording: Sequence,
    frames: Frames,
    mapping: Mapping,
    category: str,
    figures: dict[str, float],
    run: RunDirectory,
    other_paths: dict[str, tuple[Pose, ...]] | None = None,
) -> None:
    """Write report.html, and recording.rrd where the Rerun SDK is installed."""
    mean = load_category(category).vertices
    context = ReportContext(
        title=recording.name,
        camera=recording.camera,
        frame_ids=recording.frame_ids,
        world_from_camera=frames.world_from_camera,
        read_image=recording.read_image if recording.image_paths is not None else None,
        detections=mapping.detections,
        map=mapping.map,
        left_out=tuple((row.track, row.reason, row.detail) for row in mapping.left_out),
        metrics=figures,
        other_paths=other_paths or {},
        stages={number: (steps.start.world_from_object, mean) for number, steps in mapping.stages.items()},
    )
    if can_record():
        part = run.path(".recording.rrd.meshslam-part")
        write_recording(context, part)
        part.replace(run.path("recording.rrd"))
    run.save("report.html", write_report(context))
