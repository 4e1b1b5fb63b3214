"""Options that several commands share, and how they become the input of a run."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshslam.errors import ConfigError, MapError, SequenceError

if TYPE_CHECKING:
    from meshslam.runs import Config

SequenceFolder = Annotated[Path | None, typer.Argument(help="Folder or file of the recording.")]
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
CategoryName = Annotated[str | None, typer.Option(help="Category to map: a shipped one, or a file (.npz).")]
Keypoints = Annotated[
    bool | None, typer.Option("--keypoints/--no-keypoints", help="Key points of cars, by the shipped network.")
]
Camera = Annotated[
    list[str] | None,
    typer.Option(
        help="Which camera of the layout or of the extrinsics' file (a number); or a file with the camera, for "
        "recordings that have none. Both, given one after the other: which camera of the file."
    ),
]
ImuFile = Annotated[Path | None, typer.Option(help="IMU samples (CSV) instead of the layout's own.")]
RECORDING: dict[str, Any] = {  # what each command that opens a recording takes, by the setting of `input`
    "layout": Annotated[str | None, typer.Option(help="Layout, where the path does not tell: kitti-raw, folder, …")],
    "camera": Camera,
    "size": Annotated[
        str | None, typer.Option(help="Size of the images, 640x480, if the camera's file is of another.")
    ],
    "rate": Annotated[float | None, typer.Option(help="Frames a second, of a folder of frames without times.")],
    "times": Annotated[
        Path | None,
        typer.Option(help="Times of the frames of a video or folder: a file, one a line in seconds, or CSV (s or ns)."),
    ],
    "scene": Annotated[str | None, typer.Option(help="Which scene of a data set of several, such as nuScenes.")],
    "topic": Annotated[
        list[str] | None, typer.Option(help="Topics of a bag: image=/camera/image_raw, camera=, imu=, poses=.")
    ],
    "frames": Annotated[
        str | None, typer.Option(help="Frames by number, such as 100:600:2: from 100 on, below 600, every second.")
    ],
    "from_": Annotated[str | None, typer.Option("--from", help="Begin so long after the first frame: 12.5s.")],
    "to": Annotated[str | None, typer.Option(help="End so long after the first frame: 40s.")],
    "imu": ImuFile,
    "imu_from_camera": Annotated[
        Path | None, typer.Option(help="Extrinsics: 4x4 in YAML or JSON, or Kalibr's camchain-imucam.")
    ],
    "imu_time_offset": Annotated[
        float | None, typer.Option(help="Seconds by which the IMU's clock is ahead of the camera's.")
    ],
    "poses": Annotated[
        Path | None, typer.Option(help="Poses (TUM, EuRoC, VINS, KITTI, COLMAP's images.txt) instead of the layout's.")
    ],
    "poses_convention": Annotated[
        str | None,
        typer.Option(
            help="What the poses are: camera (world_from_camera, z up), quaternion-first, camera-from-world, "
            "first-camera-world or body."
        ),
    ],
    "camera_from_body": Annotated[
        Path | None, typer.Option(help="The poses are world_from_body: camera_from_body, 4x4 in YAML or JSON.")
    ],
    "poses_time_offset": Annotated[
        float | None, typer.Option(help="Seconds by which the poses' clock is ahead of the camera's.")
    ],
    "poses_scale": Annotated[
        float | None, typer.Option(help="Metres of one unit of the poses, where they are of any scale: COLMAP's.")
    ],
}
ConfigFile = Annotated[Path | None, typer.Option(help="YAML file with settings, such as a run's config.yaml.")]
FramesInReport = Annotated[
    int | None,
    typer.Option(min=2, help="Frames with images in report.html, spread over the run (default 300); more are smaller."),
]
Overwrite = Annotated[bool, typer.Option(help="Replace a run of other settings.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")]


def takes_recording(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameter `recording` becomes the flags of `RECORDING`: it gets them as settings of `input`."""
    return with_flags(command, "recording", RECORDING, _settings_of_flags)


def with_flags(
    command: Callable[..., None], parameter: str, hints: dict[str, Any], made: Callable[[dict[str, Any]], Any]
) -> Callable[..., None]:
    """A command whose `parameter` becomes the flags of `hints`; it gets what is made of their values."""
    own = inspect.signature(command, eval_str=True)
    flags = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=hint)
        for name, hint in hints.items()
        if name not in own.parameters  # slam has its own --poses
    ]
    others = [p for p in own.parameters.values() if p.name != parameter]

    @functools.wraps(command)
    def taken(**given: Any) -> None:  # noqa: ANN401 # whatever the flags hold
        values = {flag.name: given.pop(flag.name) for flag in flags}
        command(**given, **{parameter: made(values)})

    kept = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in others]
    taken.__signature__ = own.replace(parameters=[*kept, *flags])  # type: ignore[attr-defined] # typer reads it
    taken.__annotations__ = {p.name: p.annotation for p in [*kept, *flags]}
    del taken.__wrapped__
    return taken


def _settings_of_flags(given: dict[str, Any]) -> dict[str, Any]:
    found = {
        **_camera(given.pop("camera") or []),
        "topics": list(given.pop("topic") or []) or None,
        "rate_hz": given.pop("rate"),
        "from_s": _seconds(given["from_"]),
        "to_s": _seconds(given["to"]),
        "imu_time_offset_s": given.pop("imu_time_offset"),
        "poses_time_offset_s": given.pop("poses_time_offset"),
    }
    del given["from_"], given["to"]
    return {key: value for key, value in (given | found).items() if value is not None}


def _camera(given: list[str]) -> dict[str, int | Path]:
    """The number, the file, or both that `--camera` names."""
    from meshslam.errors import ConfigError

    numbers = [int(word) for word in given if word.isascii() and word.isdigit()]
    files = [Path(word) for word in given if not (word.isascii() and word.isdigit())]
    if len(numbers) > 1 or len(files) > 1:
        raise ConfigError(f"--camera {' --camera '.join(given)}: give one number, one file, or one of each")
    return {**({"camera": numbers[0]} if numbers else {}), **({"camera_file": files[0]} if files else {})}


def _seconds(text: str | None) -> float | None:
    if text is None:
        return None
    from meshslam.sequences import read_seconds

    return read_seconds(text)


def check_inputs(config: Path | None, sequence: Path | None, scene: Path | None = None) -> None:
    """Look for what a command reads first, before anything is imported that takes time; errors as for reading it."""
    from meshslam.files import map_file, must_exist, real_path

    if config is not None:
        must_exist(config, "configuration file", ConfigError)
    if scene is not None:
        must_exist(map_file(real_path(scene)), "map", MapError)
    if sequence is not None:
        must_exist(real_path(sequence), "folder or file", SequenceError)


def with_input(settings: Config, **given: Any) -> Config:  # noqa: ANN401 # whatever the settings hold
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


def _plain(key: str, value: Any) -> Any:  # noqa: ANN401 # whatever a flag holds
    from meshslam.files import real_path

    if isinstance(value, Path):
        return str(real_path(value))
    if key == "segmenter" and isinstance(value, str):  # a file, or a name in the store
        return str(real_path(value)) if Path(value).exists() or value.endswith(".onnx") else value
    if key == "category" and isinstance(value, str):  # a file, or the name of a shipped one
        return str(real_path(value)) if value.endswith(".npz") else value
    return value
