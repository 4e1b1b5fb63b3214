"""All layouts, and the one door to them."""

from __future__ import annotations

from pathlib import Path

from meshslam.errors import SequenceError
from meshslam.sequences.folder import SequenceFolder
from meshslam.sequences.kitti_odometry import KittiOdometry
from meshslam.sequences.kitti_raw import KittiRaw
from meshslam.sequences.loader import Loader, LoadOptions
from meshslam.sequences.report import Report
from meshslam.sequences.sequence import Sequence

LOADERS: tuple[Loader, ...] = (KittiRaw(), KittiOdometry(), SequenceFolder())  # asked in this order


def open_sequence(
    path: Path | str,
    layout: str | None = None,
    camera_number: int | None = None,
    detections_path: Path | None = None,
) -> Sequence:
    """Load a recording: its layout is found from the path, or named.

    `camera_number` chooses among a layout's cameras, `detections_path` takes the place of the layout's own detections.
    SequenceError with the first thing that is missing, unreadable or contradictory. Truth files are not opened.
    """
    path = Path(path)
    loader = find_loader(path, layout)
    return loader.load(path, _options(camera_number, detections_path), Report())


def find_loader(path: Path, layout: str | None = None) -> Loader:
    """Return the loader of that name, or the first that recognizes the folder; SequenceError if there is none."""
    if not path.exists():
        raise SequenceError(f"{path}: no such folder")
    if not path.is_dir():
        raise SequenceError(f"{path}: is a file, expected a sequence's folder")
    if layout is not None:
        named = [loader for loader in LOADERS if loader.name == layout]
        if not named:
            names = ", ".join(loader.name for loader in LOADERS)
            raise SequenceError(f"{path}: unknown layout {layout!r}, known are {names}")
        return named[0]
    absolute = path.resolve()
    for loader in LOADERS:
        if loader.recognizes(absolute):
            return loader
    looked = "; ".join(f"{loader.name}: {loader.looks_for}" for loader in LOADERS)
    raise SequenceError(f"{path}: no known layout. Looked for {looked}")


def _options(camera_number: int | None, detections_path: Path | None) -> LoadOptions:
    if detections_path is not None and not Path(detections_path).is_file():
        raise SequenceError(f"{detections_path}: no such detection file")
    return LoadOptions(camera_number, None if detections_path is None else Path(detections_path))
