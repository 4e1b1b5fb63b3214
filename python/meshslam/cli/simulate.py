"""`meshslam simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from meshslam.cli.options import ImuFile

if TYPE_CHECKING:
    from meshslam.simulation import SimulationConfig, Street

SIMULATED = (  # what earlier versions wrote, whose folders hold no list
    *("camera.yaml", "times.txt", "poses.tum", "imu.csv", "initial_state.yaml", "detections.json", "simulation.yaml"),
    *("objects.json", "association.json", "groundtruth.tum", "images/[0-9]*.png", "meshes/[0-9]*.ply"),
)
Modes = Literal["coloured", "textureless", "contrast"]


def simulate(
    out: Annotated[Path, typer.Argument(help="Sequence folder to write.")],
    seed: Annotated[int | None, typer.Option(min=0, help="The same seed and settings give the same bytes.")] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="Frames to draw; 28 if not given.")] = None,
    cars: Annotated[int | None, typer.Option(min=1, help="Parked cars on each side.")] = None,
    movers: Annotated[int | None, typer.Option(min=0, help="Cars that drive: ahead, then oncoming, by turns.")] = None,
    turning: Annotated[int | None, typer.Option(min=0, help="Oncoming cars that turn off.")] = None,
    mode: Annotated[
        Modes | None, typer.Option(help="contrast: bodies and key points in colours that tell them apart.")
    ] = None,
    poses: Annotated[Path | None, typer.Option(help="Camera path to drive: TUM, or KITTI's NN.txt.")] = None,
    times: Annotated[Path | None, typer.Option(help="Times of KITTI's poses, if not beside them.")] = None,
    start: Annotated[int | None, typer.Option(min=0, help="First pose of the file to use.")] = None,
    imu: ImuFile = None,
    imu_from_camera: Annotated[Path | None, typer.Option(help="How the recorded IMU is mounted (4x4).")] = None,
    noise: Annotated[
        bool | None, typer.Option("--noise/--exact", help="Masks and key points with a network's errors.")
    ] = None,
    keypoints: Annotated[
        bool | None, typer.Option("--keypoints/--no-keypoints", help="Write key points, or leave them to the network.")
    ] = None,
    known_poses: Annotated[
        bool | None, typer.Option("--known-poses/--hidden-poses", help="Write poses.tum, or the truth alone.")
    ] = None,
    config: Annotated[Path | None, typer.Option(help="YAML file: a sequence's simulation.yaml.")] = None,
    overwrite: Annotated[bool, typer.Option(help="Replace a sequence that is there.")] = False,
) -> None:
    """Draw a street of cars as a sequence with images, IMU, exact masks and key points, and truth.

    Example: meshslam simulate street --seed 3 --frames 60 && meshslam map street --out run
    """
    from meshslam.runs import overlaid, read_yaml
    from meshslam.simulation import SimulationConfig

    settings = SimulationConfig() if config is None else overlaid(SimulationConfig(), read_yaml(config), str(config))
    given: dict[str, Any] = {"seed": seed, "noise": noise, "keypoints": keypoints, "known_poses": known_poses}
    given |= {"poses": poses, "times": times, "imu": imu, "imu_from_camera": imu_from_camera, "start": start}
    given["street"] = _chosen(
        {"frames": frames, "cars_each_side": cars, "moving_cars": movers, "turning_cars": turning, "mode": mode}
    )
    run_simulate(_given(settings, given), out, overwrite=overwrite)


def run_simulate(settings: SimulationConfig, out: Path, *, overwrite: bool) -> None:
    """Draw, and put the folder in place once it is whole."""
    from meshslam.cli.progress import progress_bars
    from meshslam.errors import SequenceError
    from meshslam.files import LOCK, locked, real_path, replaced_folder, write_into
    from meshslam.runs import to_yaml
    from meshslam.simulation import simulate_street

    place = real_path(out)
    if Path.cwd().is_relative_to(place):
        raise SequenceError(f"{out}: the command runs in there, and what is drawn is put in its place: name a folder")
    place.parent.mkdir(parents=True, exist_ok=True)

    def check() -> None:
        refuse_foreign(out, overwrite=overwrite)

    with (
        locked(place.with_name(f".{place.name}{LOCK}"), str(out), SequenceError),
        replaced_folder(place, SIMULATED, check, SequenceError) as part,
    ):
        with progress_bars() as bars:
            street = simulate_street(settings, part, bars)
        write_into(part / "simulation.yaml", to_yaml(settings), SequenceError)
    print(_summary(street, out))


def refuse_foreign(out: Path, *, overwrite: bool) -> None:
    """SequenceError for a place that holds something which must stay."""
    from meshslam.errors import SequenceError

    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    if not (out / "simulation.yaml").is_file():
        raise SequenceError(f"{out}: holds something that is no simulated sequence: choose another folder")
    if not overwrite:
        raise SequenceError(f"{out}: a sequence is there already: give --overwrite, or another folder")


def _given(settings: SimulationConfig, values: dict[str, Any]) -> SimulationConfig:
    """The settings with those values that are not None; paths become text that holds in any folder."""
    from meshslam.runs import overlaid

    return overlaid(settings, _chosen(values), "flags")


def _chosen(values: dict[str, Any]) -> dict[str, Any]:
    from meshslam.files import real_path

    return {k: str(real_path(v)) if isinstance(v, Path) else v for k, v in values.items() if v is not None}


def _summary(street: Street, out: Path) -> str:
    parked = sum(not car.moves for car in street.cars)
    seconds = float(street.times_s[-1] - street.times_s[0])
    moving = len(street.cars) - parked
    return f"{out}: {len(street.times_s)} frames over {seconds:.1f} s, {parked} parked cars, {moving} moving"
