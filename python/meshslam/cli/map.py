"""`meshslam map`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshslam.cli.options import (
    AsJson,
    CameraNumber,
    CategoryName,
    ConfigFile,
    Detections,
    Keypoints,
    Layout,
    Overwrite,
    RunFolder,
    Segmenter,
    SequenceFolder,
    with_input,
    with_keypoint_network,
)

if TYPE_CHECKING:
    from meshslam.cli.config import Config


def map_(
    sequence: SequenceFolder = None,
    out: RunFolder = Path("run"),
    segmenter: Segmenter = None,
    detections: Detections = None,
    layout: Layout = None,
    camera: CameraNumber = None,
    category: CategoryName = None,
    tracker: Annotated[str | None, typer.Option(help="hungarian, or paper: greedy, tracks that are lost end.")] = None,
    solver: Annotated[
        str | None, typer.Option(help="residuals: second order on the outline; gradient: the paper's descent.")
    ] = None,
    keypoints: Keypoints = None,
    config: ConfigFile = None,
    overwrite: Overwrite = False,
    json: AsJson = False,
) -> None:
    """Map a recording with known camera poses: every parked car with its pose and its own mesh.

    Example: meshslam map 2011_09_26_drive_0048_sync --segmenter yolov5n-seg.onnx --out run48
    """
    from meshslam.cli.config import overlaid, read_config
    from meshslam.cli.figures import show_figures

    settings = with_input(
        read_config(config),
        sequence=sequence,
        segmenter=segmenter,
        detections=detections,
        layout=layout,
        camera=camera,
        category=category,
    )
    settings = with_keypoint_network(settings, keypoints)
    if tracker is not None:
        settings = replace(settings, tracking=overlaid(settings.tracking, {"tracker": tracker}, "--tracker"))
    if solver is not None:
        settings = replace(settings, mapping=overlaid(settings.mapping, {"solver": solver}, "--solver"))
    show_figures(run_map(settings, out, overwrite=overwrite), out, as_json=json)


def run_map(settings: Config, out: Path, *, overwrite: bool) -> dict[str, float]:
    """Perceive, track, map, save, evaluate, report: what is there already is not done again."""
    from meshslam.cli import stages
    from meshslam.cli.progress import progress_bars
    from meshslam.cli.report import save_map_report
    from meshslam.evaluation import evaluate_run

    recording, run, done = stages.begin(settings, out, overwrite=overwrite)
    if done is not None:
        return done
    clock = stages.Clock()
    with progress_bars() as bars:
        with clock.timing("perception"):
            found_objects, fixed = stages.perceive(recording, settings, run, bars)
        with clock.timing("tracking"):
            tracked = stages.follow(recording, found_objects, settings, bars)
        with clock.timing("mapping"):
            frames = stages.camera_path(recording, tracked, settings, bars)
            mapping = stages.build_map(frames, tracked, settings, bars, fixed_tracks=fixed)
        stages.save(recording, frames, mapping, run)
        figures = stages.figures(recording, mapping, clock) | evaluate_run(recording.root, run.folder)
        save_map_report(recording, frames, mapping, settings.input.category, figures, run)
    run.save("metrics.json", stages.metrics_json(figures))
    return figures
