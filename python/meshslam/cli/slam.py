"""`meshslam slam`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshslam.cli.options import (
    AsJson,
    CameraNumber,
    ConfigFile,
    Detections,
    Extrinsics,
    ImuFile,
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

_MAPPING_SOLVER = {"smoother": "residuals", "gradient": "gradient"}  # that goes with localization's


def slam(
    sequence: SequenceFolder = None,
    out: RunFolder = Path("run"),
    imu: ImuFile = None,
    imu_from_camera: Extrinsics = None,
    segmenter: Segmenter = None,
    detections: Detections = None,
    layout: Layout = None,
    camera: CameraNumber = None,
    keypoints: Keypoints = None,
    poses: Annotated[
        str | None, typer.Option(help="none, or odometry: known poses tell each step, with noise, instead of the IMU.")
    ] = None,
    solver: Annotated[
        str | None, typer.Option(help="smoother, or gradient: the paper's joint problem, by gradient descent.")
    ] = None,
    config: ConfigFile = None,
    overwrite: Overwrite = False,
    json: AsJson = False,
) -> None:
    """Find camera path and cars together, from detections and IMU, or from images alone; poses are not needed.

    Example: meshslam slam drive --out run
    """
    from meshslam.cli.config import overlaid, read_config
    from meshslam.cli.figures import show_figures

    settings = with_input(
        read_config(config),
        sequence=sequence,
        imu=imu,
        imu_from_camera=imu_from_camera,
        segmenter=segmenter,
        detections=detections,
        layout=layout,
        camera=camera,
    )
    settings = with_keypoint_network(settings, keypoints)
    if poses is not None:
        settings = replace(settings, slam=overlaid(settings.slam, {"poses": poses}, "--poses"))
    if solver is not None:
        chosen = overlaid(settings.localization, {"solver": solver}, "--solver")
        mapping = overlaid(settings.mapping, {"solver": _MAPPING_SOLVER[chosen.solver]}, "--solver")
        settings = replace(settings, localization=chosen, mapping=mapping)
    show_figures(run_slam(settings, out, overwrite=overwrite), out, as_json=json)


def run_slam(settings: Config, out: Path, *, overwrite: bool) -> dict[str, float]:
    """Perceive, track, estimate path and objects together, map along the path, save, evaluate, report."""
    from meshslam.categories import load_category
    from meshslam.cli import stages
    from meshslam.cli.progress import progress_bars
    from meshslam.cli.report import save_map_report
    from meshslam.cli.truth import paths_against_truth, true_path
    from meshslam.evaluation import evaluate_run
    from meshslam.localization import slam_path
    from meshslam.mapping import Frames

    recording, run, done = stages.begin(settings, out, overwrite=overwrite)
    if done is not None:
        return done
    clock, category = stages.Clock(), load_category(settings.input.category)
    with progress_bars() as bars:
        with clock.timing("perception"):
            found, fixed = stages.perceive(recording, settings, run, bars)
        stages.say_notes(recording, found, settings)
        with clock.timing("tracking"):
            # known poses beyond the first are not for SLAM, unless they are its odometry
            blind = recording if settings.slam.poses == "odometry" else replace(recording, world_from_camera=None)
            tracked = stages.follow(blind, found, settings, bars)
        with clock.timing("localization"):
            result = slam_path(
                recording,
                tracked,
                category,
                settings.localization,
                settings.slam,
                settings.mapping,
                bars,
                fixed_tracks=fixed,
            )
        height = recording.height_above_ground_m
        frames = Frames(recording.camera, recording.frame_ids, recording.times_s, result.world_from_camera, height)
        with clock.timing("mapping"):
            mapping = stages.build_map(frames, result.detections, settings, bars, fixed_tracks=fixed)
        stages.save(recording, frames, mapping, run)
        figures = stages.figures(recording, mapping, clock) | result.figures | evaluate_run(recording.root, run.folder)
        alone = {"initial": result.alone} if result.alone else {}
        by_iteration = {f"iteration_{k:02d}": path for k, path in enumerate(result.iterations)}
        figures |= paths_against_truth(recording, {**alone, "filtered": result.filtered, **by_iteration})
        drawn = ({result.alone_by: result.alone} if result.alone else {}) | true_path(recording)
        save_map_report(recording, frames, mapping, settings.input.category, figures, run, drawn)
    run.save("metrics.json", stages.metrics_json(figures))
    return figures
