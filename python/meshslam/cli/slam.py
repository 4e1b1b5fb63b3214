"""`meshslam slam`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from meshslam.cli.config import Config


def slam(
    sequence: Annotated[Path | None, typer.Argument(help="Folder of the recording.")] = None,
    out: Annotated[Path, typer.Option(help="Run directory to write.")] = Path("run"),
    imu: Annotated[Path | None, typer.Option(help="IMU samples (CSV) instead of the layout's own.")] = None,
    imu_from_camera: Annotated[
        Path | None, typer.Option(help="Extrinsics: 4x4 in YAML or JSON, or Kalibr's camchain-imucam.")
    ] = None,
    segmenter: Annotated[Path | None, typer.Option(help="ONNX export of YOLO-seg (v5, v8, 11).")] = None,
    detections: Annotated[Path | None, typer.Option(help="Detections (COCO JSON) instead of a network.")] = None,
    layout: Annotated[str | None, typer.Option(help="kitti-raw, kitti-odometry or folder.")] = None,
    camera: Annotated[int | None, typer.Option(help="Which of the layout's cameras.")] = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with settings, such as a run's config.yaml.")] = None,
    overwrite: Annotated[bool, typer.Option(help="Replace a run of other settings.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Find camera path and cars together, from detections and IMU: no poses are used but the first.

    Example: meshslam slam drive --out run
    """
    from meshslam.cli.config import overlaid, read_config
    from meshslam.cli.map import show_figures

    paths = {
        "sequence": sequence,
        "imu": imu,
        "imu_from_camera": imu_from_camera,
        "segmenter": segmenter,
        "detections": detections,
    }
    given: dict[str, object] = {key: str(path.resolve()) for key, path in paths.items() if path is not None}
    given |= {key: value for key, value in {"layout": layout, "camera": camera}.items() if value is not None}
    settings = read_config(config)
    settings = replace(settings, input=overlaid(settings.input, given, "flags"))
    show_figures(run_slam(settings, out, overwrite=overwrite), out, as_json=json)


def run_slam(settings: Config, out: Path, *, overwrite: bool) -> dict[str, float]:
    """Perceive, track, estimate path and objects together, map along the path, save, evaluate, report."""
    import json
    from importlib.metadata import version

    from meshslam.categories import load_category
    from meshslam.cli import stages
    from meshslam.cli.config import to_yaml
    from meshslam.cli.localize import paths_against_truth, true_path
    from meshslam.cli.progress import progress_bars
    from meshslam.cli.report import save_report
    from meshslam.evaluation import evaluate_run
    from meshslam.localization import slam_path
    from meshslam.mapping import Frames
    from meshslam.maps import RunDirectory

    recording = stages.open_input(settings.input)
    run = RunDirectory.start(out, to_yaml(settings), version("meshslam"), overwrite=overwrite)
    if run.has("metrics.json") and run.has("report.html"):
        done: dict[str, float] = json.loads(run.path("metrics.json").read_text())
        return done
    clock, category = stages.Clock(), load_category(settings.input.category)
    with progress_bars() as bars:
        with clock.timing("perception"):
            found, fixed = stages.perceive(recording, settings, run, bars)
        with clock.timing("tracking"):
            tracked = stages.follow(recording, found, settings, bars)
        with clock.timing("localization"):
            result = slam_path(
                recording, tracked, category, settings.localization, settings.slam, settings.mapping, bars
            )
        height = recording.height_above_ground_m
        frames = Frames(recording.camera, recording.frame_ids, recording.times_s, result.world_from_camera, height)
        with clock.timing("mapping"):
            mapping = stages.build_map(frames, tracked, settings, bars, fixed_tracks=fixed)
        stages.save(recording, frames, mapping, run)
        figures = stages.figures(recording, mapping, clock) | result.figures | evaluate_run(recording.root, run.folder)
        figures |= paths_against_truth(recording, {"initial": result.inertial, "filtered": result.filtered})
        drawn = {"IMU alone": result.inertial} | true_path(recording)
        save_report(recording, frames, mapping, settings.input.category, figures, run, drawn)
    run.save("metrics.json", stages.metrics_json(figures))
    return figures
