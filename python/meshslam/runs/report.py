"""Puts a run's report together."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence as Rows
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from meshslam.categories import load_category
from meshslam.geometry import Floats, Pose
from meshslam.maps import CameraPath, Map, RunDirectory, TrajectoryEstimate
from meshslam.perception import DetectionSet
from meshslam.runs.clock import REPORT, Clock
from meshslam.runs.outlet import Outlet
from meshslam.runs.truth import shown_truth
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
    *,
    outlet: Outlet,
) -> dict[str, float]:
    """The report of a map that was made; the figures with all times and the memory, the report's too."""
    mean = load_category(category).vertices
    stages = {number: (steps.start.world_from_object, mean) for number, steps in mapping.stages.items()}
    left_out = [(row.track, row.reason, row.detail) for row in mapping.left_out]
    path, seen = frames.world_from_camera, mapping.detections
    known = None if estimate is None else estimate.covariances
    shown = _Shown(
        path, seen, mapping.map, left_out, other_paths or {}, stages, known, made=True, placed=other_paths is not None
    )
    return _save(recording, shown, figures, run, clock, outlet)


def save_localization_report(
    recording: Sequence,
    scene: Map,
    result: Localization,
    figures: dict[str, float],
    run: RunDirectory,
    other_paths: Paths,
    clock: Clock,
    outlet: Outlet,
) -> dict[str, float]:
    """The report of a path in a map that was given; the figures as for a map."""
    moved = [(number, "was moved", f"refused from frame {frame}") for number, frame in sorted(result.moved.items())]
    path, seen = result.world_from_camera, result.detections
    known = None if result.estimate is None else result.estimate.covariances
    shown = _Shown(path, seen, scene, moved, other_paths, {}, known, made=False, placed=True)
    return _save(recording, shown, figures, run, clock, outlet)


@dataclass(frozen=True, eq=False)
class _Shown:
    """What a run found."""

    world_from_camera: tuple[Pose, ...]
    detections: DetectionSet
    scene: Map
    left_out: Rows[tuple[int, str, str]]
    other_paths: Paths  # not the true one
    stages: dict[int, tuple[Pose, Floats]]
    covariances: Floats | None
    made: bool  # whether the run made the map, so that its objects are compared with the true ones
    placed: bool  # whether it made the path, likewise


def _save(
    recording: Sequence, shown: _Shown, figures: dict[str, float], run: RunDirectory, clock: Clock, outlet: Outlet
) -> dict[str, float]:
    """Write report.html, and recording.rrd where the Rerun SDK is installed and `MESHSLAM_RECORDING` is not 0."""
    began_s = time.perf_counter()
    last: dict[str, float] = {}

    def last_figures() -> dict[str, float]:
        clock.seconds[REPORT] = time.perf_counter() - began_s
        last.update(figures | clock.figures(len(recording)))
        return last

    paths = {"estimate": shown.world_from_camera} | shown.other_paths if shown.placed else {}
    truth = shown_truth(recording, shown.scene if shown.made else None, paths)
    context = ReportContext(
        title=recording.name,
        camera=recording.camera,
        frame_ids=recording.frame_ids,
        world_from_camera=shown.world_from_camera,
        times_s=recording.times_s,
        read_image=recording.read_image if recording.images is not None else None,
        detections=shown.detections,
        map=shown.scene,
        left_out=tuple(shown.left_out),
        notes=tuple(outlet.notes),
        metrics=figures,
        other_paths=shown.other_paths | truth.path if shown.placed else {},
        stages=shown.stages,
        covariances=shown.covariances,
        true_objects=truth.objects,
        path_errors=truth.errors,
        frames_in_report=outlet.frames_in_report,
        progress=partial(outlet.progress, REPORT),
    )
    _save_charts(context, run)
    if can_record() and os.environ.get("MESHSLAM_RECORDING") != "0":
        with run.written("recording.rrd") as part:
            write_recording(context, part)
    run.save("report.html", write_report(context, last_figures))
    return last


def _save_charts(context: ReportContext, run: RunDirectory) -> None:
    """path.png and iterations.png, as in the paper; none where the path was given."""
    if not context.other_paths:
        return
    run.save("path.png", path_chart(context.map, {"estimate": context.world_from_camera} | dict(context.other_paths)))
    iterations = iterations_chart(context.metrics)
    if iterations is not None:
        run.save("iterations.png", iterations)
