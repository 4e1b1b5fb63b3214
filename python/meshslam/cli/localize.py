"""`meshslam localize`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from meshslam.cli.config import Config
    from meshslam.geometry import Pose
    from meshslam.localization import Localization
    from meshslam.maps import Map, RunDirectory
    from meshslam.sequences import Sequence


def localize(
    sequence: Annotated[Path | None, typer.Argument(help="Folder of the recording.")] = None,
    map_path: Annotated[Path | None, typer.Option("--map", help="A run, its map.json, or an objects.json.")] = None,
    out: Annotated[Path, typer.Option(help="Run directory to write.")] = Path("run"),
    imu: Annotated[Path | None, typer.Option(help="IMU samples (CSV) instead of the layout's own.")] = None,
    imu_from_camera: Annotated[
        Path | None, typer.Option(help="Extrinsics: 4x4 in YAML or JSON, or Kalibr's camchain-imucam.")
    ] = None,
    segmenter: Annotated[Path | None, typer.Option(help="ONNX export of YOLO-seg (v5, v8, 11).")] = None,
    detections: Annotated[Path | None, typer.Option(help="Detections (COCO JSON) instead of a network.")] = None,
    layout: Annotated[str | None, typer.Option(help="kitti-raw, kitti-odometry or folder.")] = None,
    camera: Annotated[int | None, typer.Option(help="Which of the layout's cameras.")] = None,
    solver: Annotated[str | None, typer.Option(help="smoother, or gradient: the paper's, pose by pose.")] = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with settings, such as a run's config.yaml.")] = None,
    overwrite: Annotated[bool, typer.Option(help="Replace a run of other settings.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Find the camera of every frame in a map of meshes, by IMU, masks and key points.

    Example: meshslam localize drive2 --map run1 --out run2
    """
    from meshslam.cli.config import overlaid, read_config
    from meshslam.cli.map import show_figures

    chosen = {
        "sequence": sequence,
        "map": map_path,
        "imu": imu,
        "imu_from_camera": imu_from_camera,
        "segmenter": segmenter,
        "detections": detections,
    }
    given: dict[str, object] = {key: str(path.resolve()) for key, path in chosen.items() if path is not None}
    given |= {key: value for key, value in {"layout": layout, "camera": camera}.items() if value is not None}
    settings = read_config(config)
    settings = replace(settings, input=overlaid(settings.input, given, "flags"))
    if solver is not None:
        settings = replace(settings, localization=overlaid(settings.localization, {"solver": solver}, "--solver"))
    show_figures(run_localize(settings, out, overwrite=overwrite), out, as_json=json)


def run_localize(settings: Config, out: Path, *, overwrite: bool) -> dict[str, float]:
    """Perceive, localize, save, evaluate, report."""
    import json
    from importlib.metadata import version

    from meshslam.cli import stages
    from meshslam.cli.config import to_yaml
    from meshslam.cli.progress import progress_bars
    from meshslam.errors import MapError
    from meshslam.localization import localize as localize_sequence
    from meshslam.maps import Map, RunDirectory, Trajectory
    from meshslam.perception import write_detections
    from meshslam.sequences import camera_yaml

    if settings.input.map is None:
        raise MapError("no map is named: give --map with a run, its map.json, or an objects.json")
    scene = Map.load(Path(settings.input.map))
    recording = stages.open_input(settings.input)
    run = RunDirectory.start(out, to_yaml(settings), version("meshslam"), overwrite=overwrite)
    if run.has("metrics.json") and run.has("report.html"):
        done: dict[str, float] = json.loads(run.path("metrics.json").read_text())
        return done
    clock = stages.Clock()
    with progress_bars() as bars:
        with clock.timing("perception"):
            found, _ = stages.perceive(recording, settings, run, bars)
        with clock.timing("localization"):
            result = localize_sequence(recording, found, scene, settings.localization, bars)
        mounted, height = recording.imu_from_camera, recording.height_above_ground_m
        run.save("camera.yaml", camera_yaml(recording.camera, None, mounted, height))
        run.save("trajectory.tum", Trajectory(recording.times_s, result.world_from_camera).to_tum())
        run.save("detections.json", write_detections(result.detections))
        figures = stages.run_figures(result.figures, len(recording), clock) | _against_truth(recording, result, run)
        _save_report(recording, scene, result, figures, run)
    run.save("metrics.json", stages.metrics_json(figures))
    return figures


def _against_truth(recording: Sequence, result: Localization, run: RunDirectory) -> dict[str, float]:
    """Figures that need truth, which is opened only now that the path is on disk."""
    from meshslam.evaluation import evaluate_run

    paths = {"initial": result.inertial, "filtered": result.filtered}
    paths |= {f"iteration_{k:02d}": poses for k, poses in enumerate(result.iterations)}
    return evaluate_run(recording.root, run.folder) | paths_against_truth(recording, paths)


def paths_against_truth(recording: Sequence, paths: dict[str, tuple[Pose, ...]]) -> dict[str, float]:
    """`ate_<name>_rmse_m` of each path; empty without truth."""
    from meshslam.evaluation import read_truth, trajectory_figures
    from meshslam.maps import Trajectory

    truth = read_truth(recording.root).path
    if truth is None:
        return {}
    found = {name: trajectory_figures(truth, Trajectory(recording.times_s, poses)) for name, poses in paths.items()}
    return {f"ate_{name}_rmse_m": rows["ate_rmse_m"] for name, rows in found.items() if "ate_rmse_m" in rows}


def true_path(recording: Sequence) -> dict[str, tuple[Pose, ...]]:
    """The true path under its name, to be drawn; empty where there is none."""
    from meshslam.evaluation import read_truth

    truth = read_truth(recording.root).path
    return {} if truth is None else {"truth": truth.world_from_camera}


def _save_report(
    recording: Sequence, scene: Map, result: Localization, figures: dict[str, float], run: RunDirectory
) -> None:
    from meshslam.viewing import ReportContext, write_report

    context = ReportContext(
        title=recording.name,
        camera=recording.camera,
        frame_ids=recording.frame_ids,
        world_from_camera=result.world_from_camera,
        read_image=recording.read_image if recording.image_paths is not None else None,
        detections=result.detections,
        map=scene,
        left_out=tuple((n, "was moved", f"refused from frame {f}") for n, f in sorted(result.moved.items())),
        metrics=figures,
        other_paths={"IMU alone": result.inertial} | true_path(recording),
    )
    run.save("report.html", write_report(context))
