"""Puts a run's report together."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence as Rows
from typing import TYPE_CHECKING

from meshslam.categories import load_category
from meshslam.geometry import Floats, Pose
from meshslam.maps import CameraPath, Map, RunDirectory, TrajectoryEstimate
from meshslam.perception import DetectionSet
from meshslam.runs.clock import REPORT, Clock
from meshslam.sequences import Sequence
from meshslam.viewing import (
    ReportContext,
    can_record,
    iterations_chart,
    path_chart,
    write_recording,
    write_report,
)

if TYPE_CHECKING:
    from meshslam.localization import Localization
    from meshslam.mapping import ObjectMapping

Paths = dict[str, tuple[Pose, ...]]


def save_map_report(
    recording: Sequence,
    frames: CameraPath,
    mapping: ObjectMapping,
    category: str,
    figures: dict[str, float],
    run: RunDirectory,
    clock: Clock,
    other_paths: Paths | None = None,
    estimate: TrajectoryEstimate | None = None,
) -> dict[str, float]:
    """The report of a map that was made; the figures with all times and the memory, the report's too."""
    mean = load_category(category).vertices
    stages = {number: (steps.start.world_from_object, mean) for number, steps in mapping.stages.items()}
    left_out = [(row.track, row.reason, row.detail) for row in mapping.left_out]
    path, seen = frames.world_from_camera, mapping.detections
    known = None if estimate is None else estimate.covariances
    return _save(recording, path, seen, mapping.map, left_out, figures, run, other_paths or {}, stages, clock, known)


def save_localization_report(
    recording: Sequence,
    scene: Map,
    result: Localization,
    figures: dict[str, float],
    run: RunDirectory,
    other_paths: Paths,
    clock: Clock,
) -> dict[str, float]:
    """The report of a path in a map that was given; the figures as for a map."""
    moved = [(number, "was moved", f"refused from frame {frame}") for number, frame in sorted(result.moved.items())]
    path, seen = result.world_from_camera, result.detections
    known = None if result.estimate is None else result.estimate.covariances
    return _save(recording, path, seen, scene, moved, figures, run, other_paths, {}, clock, known)


def _save(
    recording: Sequence,
    world_from_camera: tuple[Pose, ...],
    detections: DetectionSet,
    scene: Map,
    left_out: Rows[tuple[int, str, str]],
    figures: dict[str, float],
    run: RunDirectory,
    other_paths: Paths,
    stages: dict[int, tuple[Pose, Floats]],
    clock: Clock,
    covariances: Floats | None,
) -> dict[str, float]:
    """Write report.html, and recording.rrd where the Rerun SDK is installed and `MESHSLAM_RECORDING` is not 0."""
    began_s = time.perf_counter()
    last: dict[str, float] = {}

    def last_figures() -> dict[str, float]:
        clock.seconds[REPORT] = time.perf_counter() - began_s
        last.update(figures | clock.figures(len(recording)))
        return last

    context = ReportContext(
        title=recording.name,
        camera=recording.camera,
        frame_ids=recording.frame_ids,
        world_from_camera=world_from_camera,
        times_s=recording.times_s,
        read_image=recording.read_image if recording.images is not None else None,
        detections=detections,
        map=scene,
        left_out=tuple(left_out),
        other_paths=other_paths,
        stages=stages,
        covariances=covariances,
        charts=_charts(world_from_camera, scene, other_paths, figures, run),
    )
    if can_record() and os.environ.get("MESHSLAM_RECORDING") != "0":
        with run.written("recording.rrd") as part:
            write_recording(context, part)
    run.save("report.html", write_report(context, last_figures))
    return last


def _charts(
    path: tuple[Pose, ...], scene: Map, others: Paths, figures: dict[str, float], run: RunDirectory
) -> tuple[tuple[str, bytes], ...]:
    """path.png and iterations.png, as in the paper; none where the path was given."""
    if not others:
        return ()
    drawn = dict(reversed(others.items())) | {"estimate": path}  # truth below, the estimate on top
    charts = [("path.png", "The path among the objects, from above.", path_chart(scene, drawn))]
    iterations = iterations_chart(figures)
    if iterations is not None:
        charts.append(("iterations.png", "The path's error after each iteration.", iterations))
    for name, _, content in charts:
        run.save(name, content)
    return tuple((caption, content) for _, caption, content in charts)
