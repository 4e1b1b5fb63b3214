"""All layouts, and the one door to them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from meshslam.errors import SequenceError
from meshslam.files import real_path
from meshslam.sequences.conventions import CONVENTIONS, Convention
from meshslam.sequences.folder import SequenceFolder
from meshslam.sequences.imu_files import read_camera_from_body, with_imu
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
    poses_convention: Convention = "camera",
    camera_from_body: Path | str | None = None,
    use_imu: bool = True,
) -> Sequence:
    """Load a recording: its layout is found from the path, or named.

    `camera_number` chooses among the cameras of a layout, or of the rig that `imu_from_camera` holds.
    `detections_path`, a detections.json, takes the place of the layout's own detections. `imu` is a CSV file and
    `imu_from_camera` a YAML or JSON file, Kalibr's too; both take the place of the layout's own. `poses_convention`
    says what poses.tum holds, where that is not world_from_camera with z up: quaternion-first, camera-from-world,
    first-camera-world or body; with the file `camera_from_body` it holds world_from_body. Without `use_imu` a sequence
    folder's IMU is not read. SequenceError with the first thing that is missing, unreadable or contradictory; what
    could be handled stands in `notes`. Truth files are not opened.

    Example:
        drive = meshslam.open_sequence("06", imu="imu/06.csv", imu_from_camera="camera_from_imu.json")
        drive.camera, len(drive), drive.times_s  # Camera, number of frames, (n,) seconds
        drive.read_image(0)  # BGR (h, w, 3), undistorted
        drive.imu.between(0.0, 0.1)  # the samples of the first 0.1 s

    """
    path, report = Path(path), Report()
    loader = find_loader(path, layout)
    options = load_options(
        loader, path, camera_number, detections_path, imu, imu_from_camera, poses_convention, camera_from_body, use_imu
    )
    found = loader.load(path, options, report)
    found = replace(found, notes=report.notes)
    if not use_imu or (imu is None and imu_from_camera is None):
        return found
    samples, mounted = (None if file is None else Path(file) for file in (imu, imu_from_camera))
    return with_imu(found, samples, mounted, camera_number if loader.name == "folder" else None)


def load_options(
    loader: Loader,
    path: Path,
    camera_number: int | None,
    detections_path: Path | str | None,
    imu: Path | str | None = None,
    imu_from_camera: Path | str | None = None,
    poses_convention: Convention = "camera",
    camera_from_body: Path | str | None = None,
    use_imu: bool = True,
) -> LoadOptions:
    """What `open_sequence` was given, as a loader takes it; SequenceError for what does not go together."""
    given = None if detections_path is None else Path(detections_path)
    if given is not None and not given.is_file():
        raise SequenceError(f"{given}: no such detection file")
    if poses_convention not in CONVENTIONS:
        raise SequenceError(f"unknown convention of poses {poses_convention!r}, known are {', '.join(CONVENTIONS)}")
    body = None if camera_from_body is None else read_camera_from_body(Path(camera_from_body))
    if body is not None and poses_convention not in ("camera", "body"):
        raise SequenceError(f"{camera_from_body}: poses of a body are not of the convention {poses_convention}")
    if loader.name != "folder" and (body is not None or poses_convention != "camera"):
        raise SequenceError(f"{path}: the convention of poses can be chosen for poses.tum of a sequence folder only")
    if loader.name == "folder" and imu_from_camera is not None:
        camera_number = None  # the rig file's
    return LoadOptions(camera_number, given, use_imu and imu is None, poses_convention, body)


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
    absolute = real_path(path)
    for loader in LOADERS:
        if loader.recognizes(absolute):
            return loader
    looked = "; ".join(f"{loader.name}: {loader.looks_for}" for loader in LOADERS)
    raise SequenceError(f"{path}: no known layout. Looked for {looked}")
