"""A run's folder in other formats."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from meshslam.errors import MapError, MeshslamError
from meshslam.exporting import FORMATS, FinishedRun, GeoOrigin, check_format, export_content
from meshslam.geometry import Bytes
from meshslam.runs.opening import open_input
from meshslam.runs.settings import read_config
from meshslam.sequences import Sequence as Recording


def export_run(
    folder: Path | str,
    formats: Sequence[str],
    out: Path | str | None = None,
    *,
    origin: GeoOrigin | None = None,
    images: bool = True,
    overwrite: bool = False,
    progress: Callable[[str, int, int], None] = lambda _step, _done, _total: None,
) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Write a run's folder in formats of `meshslam.exporting.FORMATS`; where each is, and what is to be said of them.

    One format is written to `out`, several into the folder `out`; by default all go into `export` in the run's folder.
    Images of the recording, where it is still where the run read it, go into `rrd` and `mcap`, unless `images` is
    False. ConfigError and MapError as for `export_content`, before anything is written where that can be.

    Example:
        export_run("run", ["glb", "tum"], "handed_on")

    """
    for name in formats:
        check_format(name, origin)
    folder = Path(folder)
    run, notes = FinishedRun.load(folder), list[str]()
    if run.tiled is not None:
        _refuse_without_path(folder, formats)
    elif images and any(FORMATS[name].takes_images for name in formats):
        run, said = _with_images(run, folder)
        notes += said
    notes += run.notes
    written: dict[str, Path] = {}
    for done, name in enumerate(formats):
        progress("export", done, len(formats))
        target = _target(folder, name, out, alone=len(formats) == 1)
        content = run if FORMATS[name].in_tiles else run.whole()
        notes += export_content(content, name, target, origin, overwrite=overwrite)
        written[name] = target
    progress("export", len(formats), len(formats))
    return written, tuple(notes)


def _refuse_without_path(folder: Path, formats: Sequence[str]) -> None:
    """MapError for formats that a map in tiles has too little for."""
    for name in formats:
        if not FORMATS[name].of_map:
            possible = ", ".join(known for known, found in FORMATS.items() if found.of_map)
            raise MapError(f"{folder}: is a map in tiles, without a path: --format {name} needs one; {possible} do not")


def _target(folder: Path, name: str, out: Path | str | None, *, alone: bool) -> Path:
    if out is None:
        return folder / "export" / FORMATS[name].default_name
    return Path(out) if alone else Path(out) / FORMATS[name].default_name


def _with_images(run: FinishedRun, folder: Path) -> tuple[FinishedRun, list[str]]:
    """The run with its recording's images, or the reason why there are none."""
    try:
        recording = open_input(read_config(folder / "config.yaml").input, use_imu=False)
    except MeshslamError as error:
        return run, [f"no images: the recording cannot be opened again: {error}"]
    if recording.images is None:
        return run, []
    index = {frame: i for i, frame in enumerate(recording.frame_ids)}
    if not set(run.frame_ids) <= set(index):
        return run, [f"no images: {recording.root} has other frames than the run"]
    return replace(run, read_image=_reader(recording, [index[frame] for frame in run.frame_ids])), []


def _reader(recording: Recording, index_of: list[int]) -> Callable[[int], Bytes]:
    return lambda index: recording.read_image(index_of[index])
