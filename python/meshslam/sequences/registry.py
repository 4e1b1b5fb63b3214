"""All layouts, and the one door to them."""

from __future__ import annotations

from pathlib import Path

from meshslam.errors import SequenceError
from meshslam.sequences.folder import SequenceFolder
from meshslam.sequences.imu_files import with_imu
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
    detections_path: Path | str | None = None,
    *,
    imu: Path | str | None = None,
    imu_from_camera: Path | str | None = None,
) -> Sequence:
    """Load a recording: its layout is found from the path, or named.

    `camera_number` chooses among a layout's cameras. `detections_path`, a detections.json, takes the place of the
    layout's own detections. `imu` is a CSV file and `imu_from_camera` a YAML or JSON file, Kalibr's too; both take the
    place of the layout's own. SequenceError with the first thing that is missing, unreadable or contradictory. Truth
    files are not opened.

    Example:
        drive = meshslam.open_sequence("06", imu="imu/06.csv", imu_from_camera="camera_from_imu.json")
        drive.camera, len(drive), drive.times_s  # Camera, number of frames, (n,) seconds
        drive.read_image(0)  # BGR (h, w, 3), undistorted
        drive.imu.between(0.0, 0.1)  # the samples of the first 0.1 s

    """
    path = Path(path)
    loader = find_loader(path, layout)
    given = None if detections_path is None else Path(detections_path)
    found = loader.load(path, _options(camera_number, given), Report())
    if imu is None and imu_from_camera is None:
        return found
    return with_imu(found, *(None if file is None else Path(file) for file in (imu, imu_from_camera)))


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
