"""`meshslam reproduce`: the paper's experiments."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshslam.cli.options import ConfigFile, Overwrite, Segmenter, with_input

if TYPE_CHECKING:
    from meshslam.experiments import Experiment

reproduce_app = typer.Typer(help="The paper's experiments, each in one command.", no_args_is_help=True)
Out = Annotated[Path, typer.Option(help="Folder for figures, pictures and the page.")]
Seed = Annotated[int, typer.Option(min=0, help="The same seed gives the same figures.")]


@reproduce_app.command("views")
def views(
    out: Out = Path("reproduce_views"),
    seed: Seed = 0,
    count: Annotated[list[int] | None, typer.Option(min=1, max=12, help="Numbers of views; 1 to 12.")] = None,
    paper_count: Annotated[list[int] | None, typer.Option(min=1, max=12, help="The same, paper's solver.")] = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with settings of mapping.")] = None,
) -> None:
    """Mask and voxel IoU over the number of views, with both solvers, on kinds of cars the shape space has not seen.

    Example: meshslam reproduce views --out views
    """
    from meshslam.cli.progress import progress_bars
    from meshslam.experiments import ViewsConfig, views_experiment
    from meshslam.runs import read_config

    chosen = ViewsConfig(seed=seed)
    if count:
        chosen = replace(chosen, views=tuple(sorted(set(count))))
        chosen = replace(chosen, paper_views=chosen.views)
    if paper_count:
        chosen = replace(chosen, paper_views=tuple(sorted(set(paper_count))))
    with progress_bars() as bars:
        found = views_experiment(chosen, read_config(config, "reproduce views").objects, bars)
    show(found, out)


@reproduce_app.command("localization")
def localization(
    out: Out = Path("reproduce_localization"),
    seed: Seed = 0,
    poses: Annotated[Path | None, typer.Option(help="Path that was driven: TUM, or KITTI's NN.txt.")] = None,
    imu: Annotated[Path | None, typer.Option(help="IMU samples (CSV).")] = None,
    times: Annotated[Path | None, typer.Option(help="Times of KITTI's poses, if not beside them.")] = None,
    imu_from_camera: Annotated[
        Path | None, typer.Option(help="Extrinsics: 4x4 in YAML or JSON, or Kalibr's camchain-imucam.")
    ] = None,
    start: Annotated[int, typer.Option(min=0, help="First pose of the file to use.")] = 0,
    frames: Annotated[int, typer.Option(min=2, help="Frames to draw.")] = 70,
    config: Annotated[Path | None, typer.Option(help="YAML file with settings of localization.")] = None,
) -> None:
    """Find the camera among six known cars, by colours and IMU, with the paper's solver and the default.

    Example: meshslam reproduce localization --poses poses/06.txt --imu 06.csv --imu-from-camera mounted.yaml
    """
    from meshslam.cli.progress import progress_bars
    from meshslam.experiments import STREET, localization_experiment
    from meshslam.runs import read_config
    from meshslam.simulation import SimulationConfig

    simulation = SimulationConfig(
        seed=seed,
        street=replace(STREET, frames=frames),
        known_poses=False,
        poses=_text(poses),
        times=_text(times),
        imu=_text(imu),
        imu_from_camera=_text(imu_from_camera),
        start=start,
    )
    settings = read_config(config, "reproduce localization")
    with progress_bars() as bars:
        given = (simulation, settings.estimation, settings.localization)
        found = localization_experiment(*given, out / "sequence", bars)
    show(found, out)


@reproduce_app.command("kitti")
def kitti(
    drives: Annotated[list[Path], typer.Argument(help="Recordings: KITTI raw, KITTI odometry, sequence folders.")],
    out: Out = Path("reproduce_kitti"),
    segmenter: Segmenter = None,
    labels: Annotated[
        list[Path] | None, typer.Option(help="KITTI tracking labels of the cars, one file a drive, in their order.")
    ] = None,
    config: ConfigFile = None,
    overwrite: Overwrite = False,
) -> None:
    """Table I of the paper for real drives; where places of cars are known, how many were found and how far off.

    Example: meshslam reproduce kitti 2011_09_26_drive_0048_sync --segmenter yolov5n-seg.onnx --out kitti
    """
    from meshslam.cli.progress import run_outlet
    from meshslam.experiments import MappedDrive, kitti_experiment
    from meshslam.files import real_path
    from meshslam.runs import open_input, read_config, run_map

    if labels and len(labels) != len(drives):
        raise typer.BadParameter(f"{len(labels)} files for {len(drives)} drives", param_hint="--labels")
    settings, mapped = read_config(config, "map"), []
    for number, drive in enumerate(drives):
        chosen = with_input(settings, sequence=drive, segmenter=segmenter)
        run = out / f"{number}_{real_path(drive).name}"
        with run_outlet() as outlet:
            run_map(chosen, run, outlet, overwrite=overwrite)
        mapped.append(MappedDrive(open_input(chosen.input), run, labels[number] if labels else None))
    show(kitti_experiment(mapped), out)


def show(found: Experiment, out: Path) -> None:
    """Write an experiment, print the paper's numbers beside ours."""
    from rich.console import Console
    from rich.table import Table

    from meshslam.experiments import write_experiment

    report = write_experiment(found, out)
    table = Table("", "paper", "here", title=found.title)
    for claim in found.claims:
        table.add_row(claim.what, *(_shown(value) for value in (claim.paper, claim.ours)))
    Console().print(table)
    print(f"{report}: open it in a browser")


def _text(path: Path | None) -> str | None:
    from meshslam.files import real_path

    return None if path is None else str(real_path(path))


def _shown(value: float | int | str | None) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)
