"""All layouts, and the one door to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from meshslam.errors import SequenceError
from meshslam.files import must_exist, real_path
from meshslam.sequences.bags.loader import Mcap, RosBag
from meshslam.sequences.conventions import Convention
from meshslam.sequences.folder import SequenceFolder
from meshslam.sequences.kitti_odometry import KittiOdometry
from meshslam.sequences.kitti_raw import KittiRaw
from meshslam.sequences.layouts.colmap import Colmap
from meshslam.sequences.layouts.euroc import Euroc
from meshslam.sequences.layouts.frames import Frames
from meshslam.sequences.layouts.kitti_360 import Kitti360
from meshslam.sequences.layouts.kitti_tracking import KittiTracking
from meshslam.sequences.layouts.nuscenes import NuScenes
from meshslam.sequences.layouts.tum_rgbd import TumRgbd
from meshslam.sequences.loader import Loader
from meshslam.sequences.opening import RecordingOptions, opened
from meshslam.sequences.report import Report
from meshslam.sequences.selection import read_selection
from meshslam.sequences.sequence import Sequence
from meshslam.sequences.video import Video

LOADERS: tuple[Loader, ...] = (  # asked in this order: those that are told by more than names first
    RosBag(),
    Mcap(),
    Video(),
    KittiTracking(),
    Kitti360(),
    Euroc(),
    TumRgbd(),
    NuScenes(),
    Colmap(),
    KittiRaw(),
    KittiOdometry(),
    SequenceFolder(),
    Frames(),
)


def open_sequence(
    path: Path | str,
    layout: str | None = None,
    camera_number: int | None = None,
    detections_path: Path | str | None = None,
    *,
    camera: Path | str | None = None,
    size: tuple[int, int] | None = None,
    rate_hz: float | None = None,
    times: Path | str | None = None,
    scene: str | None = None,
    imu: Path | str | None = None,
    imu_from_camera: Path | str | None = None,
    imu_time_offset_s: float = 0.0,
    poses: Path | str | None = None,
    poses_convention: Convention = "camera",
    camera_from_body: Path | str | None = None,
    poses_time_offset_s: float = 0.0,
    poses_scale: float = 1.0,
    topics: Mapping[str, str] | None = None,
    frames: str | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    use_imu: bool = True,
) -> Sequence:
    """Load a recording, a folder or a file: its layout is found from what is there, or named.

    `camera_number` chooses among the cameras of a layout, or of the rig that `imu_from_camera` holds; `camera` is a
    file with the camera of recordings that have none, `size` (width, height) that of their images if it is another
    than the file's, `rate_hz` the number of frames a second where there are no times, `times` a file with the times
    of a video's or folder's frames: one a line in seconds, or a CSV in s or ns. `detections_path`, a
    detections.json, takes the place of the layout's own detections. `imu` is a CSV file and `imu_from_camera` a
    YAML or JSON file, Kalibr's too; both take the place of the layout's own. `poses` is a file of poses (TUM,
    EuRoC, VINS, KITTI, COLMAP's images.txt) in place of the layout's own. `poses_convention` says what it, or
    poses.tum, holds, where that is not world_from_camera with z up: quaternion-first, camera-from-world,
    first-camera-world or body; with the file `camera_from_body` it holds world_from_body. The clocks of IMU and
    poses are `…_time_offset_s` ahead of the frames'. `poses_scale` is what positions are multiplied by to be
    metres. `scene` is one of a data set of several (nuScenes). `topics` name a bag's topics, such as {"image":
    "/camera/image_raw"}. `frames`, `from_s` and `to_s` choose a part: FIRST:END:STRIDE by frame numbers, and
    seconds after the first frame. Without `use_imu` a sequence folder's IMU is not read. SequenceError with the
    first thing that is missing, unreadable or contradictory; what could be handled stands in `notes`. Truth files
    are not opened.

    Example:
        drive = meshslam.open_sequence("06", imu="imu/06.csv", imu_from_camera="camera_from_imu.json")
        drive.camera, len(drive), drive.times_s  # Camera, number of frames, (n,) seconds
        drive.read_image(0)  # BGR (h, w, 3), undistorted
        drive.imu.between(0.0, 0.1)  # the samples of the first 0.1 s

    """
    given = RecordingOptions(
        layout=layout,
        camera_number=camera_number,
        camera_file=_path(camera),
        size=size,
        rate_hz=rate_hz,
        times_file=_path(times),
        scene=scene,
        detections_path=_path(detections_path),
        imu=_path(imu),
        imu_from_camera=_path(imu_from_camera),
        imu_time_offset_s=imu_time_offset_s,
        poses=_path(poses),
        poses_convention=poses_convention,
        camera_from_body=_path(camera_from_body),
        poses_time_offset_s=poses_time_offset_s,
        poses_scale=poses_scale,
        topics=topics or {},
        selection=replace(read_selection(frames), from_s=from_s, to_s=to_s),
        use_imu=use_imu,
    )
    return open_with(Path(path), given)


def open_with(path: Path, given: RecordingOptions) -> Sequence:
    """`open_sequence` with everything that was chosen in one; SequenceError as there."""
    report = Report(progress=given.progress)
    found = opened(find_loader(path, given.layout), path, given, report)
    return replace(found, notes=(*report.notes, *found.notes))


def _path(given: Path | str | None) -> Path | None:
    return None if given is None else Path(given)


def find_loader(path: Path, layout: str | None = None) -> Loader:
    """Return the loader of that name, or the first that recognizes the folder or file; SequenceError if none does."""
    must_exist(path, "folder or file", SequenceError)
    if layout is not None:
        named = [loader for loader in LOADERS if loader.name == layout]
        if not named:
            names = ", ".join(loader.name for loader in LOADERS)
            raise SequenceError(f"{path}: unknown layout {layout!r}, known are {names}")
        return named[0]
    absolute = real_path(path)
    if (path / "manifest.json").is_file() and (path / "config.yaml").is_file() and not (path / "times.txt").exists():
        raise SequenceError(f"{path}: is a run of meshslam, no recording: its config.yaml names the recording")
    for loader in LOADERS:
        if loader.recognizes(absolute):
            return loader
    if path.is_file() and not path.stat().st_size:
        raise SequenceError(f"{path}: the file is empty: was it copied whole?")
    names = ", ".join(loader.name for loader in LOADERS)
    kind = "folder" if path.is_dir() else "file"
    raise SequenceError(f"{path}: no known layout: the {kind} is none of {names} (docs/recordings.md): --layout NAME")
