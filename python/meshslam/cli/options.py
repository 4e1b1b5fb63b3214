"""Options that several commands share, and how they become the input of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from meshslam.runs import Config

SequenceFolder = Annotated[Path | None, typer.Argument(help="Folder of the recording.")]
RunFolder = Annotated[Path, typer.Option(help="Run directory to write; found again, it is resumed.")]
Segmenter = Annotated[
    str | None, typer.Option(help="ONNX file, a name in `meshslam models list`, or colour: a simulated world's.")
]
Detections = Annotated[Path | None, typer.Option(help="Detections (COCO JSON) instead of a network.")]
Adapter = Annotated[
    Path | None, typer.Option(help="How the network is fed and read (YAML), instead of NAME.adapter.yaml beside it.")
]
Classes = Annotated[
    str | None, typer.Option(help="Classes that are others of ours: vehicle=car, or vehicle=car,Van=car.")
]
Layout = Annotated[str | None, typer.Option(help="kitti-raw, kitti-odometry or folder, where the path does not tell.")]
CameraNumber = Annotated[int | None, typer.Option(help="Which camera of the layout, or of the extrinsics' file.")]
CategoryName = Annotated[str | None, typer.Option(help="Category to map: a shipped one, or a file (.npz).")]
Keypoints = Annotated[
    bool | None, typer.Option("--keypoints/--no-keypoints", help="Key points of cars, by the shipped network.")
]
ImuFile = Annotated[Path | None, typer.Option(help="IMU samples (CSV) instead of the layout's own.")]
Extrinsics = Annotated[Path | None, typer.Option(help="Extrinsics: 4x4 in YAML or JSON, or Kalibr's camchain-imucam.")]
PosesConvention = Annotated[
    str | None,
    typer.Option(
        help="What poses.tum holds: camera (world_from_camera, z up), quaternion-first, camera-from-world, "
        "first-camera-world or body."
    ),
]
CameraFromBody = Annotated[
    Path | None, typer.Option(help="poses.tum holds world_from_body: camera_from_body, 4x4 in YAML or JSON.")
]
ConfigFile = Annotated[Path | None, typer.Option(help="YAML file with settings, such as a run's config.yaml.")]
Overwrite = Annotated[bool, typer.Option(help="Replace a run of other settings.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")]


def with_input(settings: Config, **given: str | int | Path | None) -> Config:
    """The settings with what was given of their input; files by their whole paths, so that a run can be repeated."""
    from meshslam.runs import overlaid

    values: dict[str, object] = {key: _plain(key, value) for key, value in given.items() if value is not None}
    if isinstance(values.get("category_names"), str):
        values["category_names"] = class_list(str(values["category_names"]))
    return overlaid(settings, {"input": values}, "flags")


def with_keypoint_network(settings: Config, keypoints: bool | None) -> Config:
    """The settings with the network of key points switched on or off, if the flag was given."""
    from meshslam.runs import overlaid

    return settings if keypoints is None else overlaid(settings, {"keypoints": {"enabled": keypoints}}, "flags")


def class_list(given: str) -> list[str]:
    """Pairs of `--classes`, as the setting has them; ConfigError for what is none."""
    from meshslam.perception import renamings

    pairs = [entry.strip() for entry in given.split(",") if entry.strip()]
    renamings(pairs or [given])
    return pairs


def _plain(key: str, value: str | int | Path) -> str | int:
    from meshslam.files import real_path

    if isinstance(value, Path):
        return str(real_path(value))
    if key == "segmenter" and isinstance(value, str):  # a file, or a name in the store
        return str(real_path(value)) if Path(value).exists() or value.endswith(".onnx") else value
    if key == "category" and isinstance(value, str):  # a file, or the name of a shipped one
        return str(real_path(value)) if value.endswith(".npz") else value
    return value
