"""`meshslam localize`."""

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


def localize(
    sequence: SequenceFolder = None,
    map_path: Annotated[Path | None, typer.Option("--map", help="A run, its map.json, or an objects.json.")] = None,
    out: RunFolder = Path("run"),
    imu: ImuFile = None,
    imu_from_camera: Extrinsics = None,
    segmenter: Segmenter = None,
    detections: Detections = None,
    layout: Layout = None,
    camera: CameraNumber = None,
    keypoints: Keypoints = None,
    solver: Annotated[str | None, typer.Option(help="smoother, or gradient: the paper's, pose by pose.")] = None,
    config: ConfigFile = None,
    overwrite: Overwrite = False,
    json: AsJson = False,
) -> None:
    """Find the camera of every frame in a map of meshes, by IMU, masks and key points.

    Example: meshslam localize drive2 --map run1 --out run2
    """
    from meshslam.cli.config import overlaid, read_config
    from meshslam.cli.figures import show_figures

    settings = with_input(
        read_config(config),
        sequence=sequence,
        map=map_path,
        imu=imu,
        imu_from_camera=imu_from_camera,
        segmenter=segmenter,
        detections=detections,
        layout=layout,
        camera=camera,
    )
    settings = with_keypoint_network(settings, keypoints)
    if solver is not None:
        settings = replace(settings, localization=overlaid(settings.localization, {"solver": solver}, "--solver"))
    show_figures(run_localize(settings, out, overwrite=overwrite), out, as_json=json)


def run_localize(settings: Config, out: Path, *, overwrite: bool) -> dict[str, float]:
    """Perceive, localize, save, evaluate, report."""
    from meshslam.cli import stages
    from meshslam.cli.progress import progress_bars
    from meshslam.cli.report import save_localization_report
    from meshslam.cli.truth import paths_against_truth, true_path
    from meshslam.errors import MapError
    from meshslam.evaluation import evaluate_run
    from meshslam.localization import localize as localize_sequence
    from meshslam.maps import Map, Trajectory
    from meshslam.perception import write_detections
    from meshslam.sequences import camera_yaml

    if settings.input.map is None:
        raise MapError("no map is named: give --map with a run, its map.json, or an objects.json")
    scene = Map.load(Path(settings.input.map))
    recording, run, done = stages.begin(settings, out, overwrite=overwrite)
    if done is not None:
        return done
    clock = stages.Clock()
    with progress_bars() as bars:
        with clock.timing("perception"):
            found, _ = stages.perceive(recording, settings, run, bars)
        stages.say_notes(recording, found, settings)
        with clock.timing("localization"):
            result = localize_sequence(recording, found, scene, settings.localization, bars)
        mounted, height = recording.imu_from_camera, recording.height_above_ground_m
        run.save("camera.yaml", camera_yaml(recording.camera, None, mounted, height))
        run.save("trajectory.tum", Trajectory(recording.times_s, result.world_from_camera).to_tum())
        run.save("detections.json", write_detections(result.detections))
        paths = {"initial": result.inertial, "filtered": result.filtered}
        paths |= {f"iteration_{k:02d}": poses for k, poses in enumerate(result.iterations)}
        figures = stages.run_figures(result.figures, len(recording), clock)
        figures |= evaluate_run(recording.root, run.folder) | paths_against_truth(recording, paths)
        drawn = {"IMU alone": result.inertial} | true_path(recording)
        save_localization_report(recording, scene, result, figures, run, drawn)
    run.save("metrics.json", stages.metrics_json(figures))
    return figures
