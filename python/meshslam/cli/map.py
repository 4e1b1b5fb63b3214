"""`meshslam map`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from meshslam.cli.config import Config


def map_(
    sequence: Annotated[Path | None, typer.Argument(help="Folder of the recording.")] = None,
    out: Annotated[Path, typer.Option(help="Run directory to write; found again, it is resumed.")] = Path("run"),
    segmenter: Annotated[str | None, typer.Option(help="ONNX file, or a name in `meshslam models list`.")] = None,
    detections: Annotated[Path | None, typer.Option(help="Detections (COCO JSON) instead of a network.")] = None,
    layout: Annotated[str | None, typer.Option(help="kitti-raw, kitti-odometry or folder.")] = None,
    camera: Annotated[int | None, typer.Option(help="Which of the layout's cameras.")] = None,
    category: Annotated[str | None, typer.Option(help="Category to map: a shipped one, or a file (.npz).")] = None,
    tracker: Annotated[str | None, typer.Option(help="hungarian, or paper: greedy, tracks that are lost end.")] = None,
    solver: Annotated[
        str | None, typer.Option(help="residuals: second order on the outline; gradient: the paper's descent.")
    ] = None,
    keypoints: Annotated[
        bool | None, typer.Option("--keypoints/--no-keypoints", help="Key points of cars, by the shipped network.")
    ] = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with settings, such as a run's config.yaml.")] = None,
    overwrite: Annotated[bool, typer.Option(help="Replace a run of other settings.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Map a recording with known camera poses: every parked car with its pose and its own mesh.

    Example: meshslam map 2011_09_26_drive_0048_sync --segmenter yolov5n-seg.onnx --out run48
    """
    from meshslam.cli.config import overlaid, read_config

    chosen = {
        "sequence": None if sequence is None else str(sequence.resolve()),
        "segmenter": None if segmenter is None else named_or_path(segmenter),
        "detections": None if detections is None else str(detections.resolve()),
        "layout": layout,
        "camera": camera,
        "category": None if category is None else category_or_path(category),
    }
    settings = read_config(config)
    given = {key: value for key, value in chosen.items() if value is not None}
    settings = replace(settings, input=overlaid(settings.input, given, "flags"))
    if keypoints is not None:
        settings = replace(settings, keypoints=replace(settings.keypoints, enabled=keypoints))
    if tracker is not None:
        settings = replace(settings, tracking=overlaid(settings.tracking, {"tracker": tracker}, "--tracker"))
    if solver is not None:
        settings = replace(settings, mapping=overlaid(settings.mapping, {"solver": solver}, "--solver"))
    figures = run_map(settings, out, overwrite=overwrite)
    show_figures(figures, out, as_json=json)


def named_or_path(segmenter: str) -> str:
    """The whole path of a file, the name of a network in the store."""
    return str(Path(segmenter).resolve()) if Path(segmenter).exists() or segmenter.endswith(".onnx") else segmenter


def category_or_path(category: str) -> str:
    """The whole path of a category file, the name of a shipped category."""
    return str(Path(category).resolve()) if category.endswith(".npz") else category


def run_map(settings: Config, out: Path, *, overwrite: bool) -> dict[str, float]:
    """Perceive, track, map, save, evaluate, report: what is there already is not done again."""
    import json
    from importlib.metadata import version

    from meshslam.cli import stages
    from meshslam.cli.config import to_yaml
    from meshslam.cli.progress import progress_bars
    from meshslam.cli.report import save_report
    from meshslam.evaluation import evaluate_run
    from meshslam.maps import RunDirectory

    recording = stages.open_input(settings.input)
    run = RunDirectory.start(out, to_yaml(settings), version("meshslam"), overwrite=overwrite)
    if run.has("metrics.json") and run.has("report.html"):
        found: dict[str, float] = json.loads(run.path("metrics.json").read_text())
        return found
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
        save_report(recording, frames, mapping, settings.input.category, figures, run)
    run.save("metrics.json", stages.metrics_json(figures))
    return figures


def show_figures(figures: dict[str, float], out: Path, *, as_json: bool) -> None:
    """Print a run's figures, and where its report is."""
    if as_json:
        from meshslam.cli.stages import metrics_json

        print(metrics_json(figures), end="")
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("figure", "value", title=str(out))
    for key, value in figures.items():
        table.add_row(key, f"{value:.3f}" if isinstance(value, float) else str(value))
    Console().print(table)
    print(f"{out / 'report.html'}: open it in a browser")
