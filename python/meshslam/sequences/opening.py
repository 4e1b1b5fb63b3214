"""What a user chooses about a recording, and how it is opened with that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.sequences.conventions import CONVENTIONS, Convention
from meshslam.sequences.loader import Loader, LoadOptions
from meshslam.sequences.mounting_files import read_camera_from_body, with_imu
from meshslam.sequences.pose_files import with_poses
from meshslam.sequences.report import Progress, Report, no_progress
from meshslam.sequences.selection import Selection, selected
from meshslam.sequences.sequence import Sequence


@dataclass(frozen=True)
class RecordingOptions:
    """Everything that can be chosen about a recording; what is None or empty is the layout's own."""

    layout: str | None = None
    camera_number: int | None = None
    camera_file: Path | None = None
    size: tuple[int, int] | None = None
    rate_hz: float | None = None
    times_file: Path | None = None
    scene: str | None = None
    detections_path: Path | None = None
    imu: Path | None = None
    imu_from_camera: Path | None = None
    imu_time_offset_s: float = 0.0  # by which the IMU's clock is ahead of the camera's
    poses: Path | None = None
    poses_convention: Convention = "camera"
    camera_from_body: Path | None = None
    poses_time_offset_s: float = 0.0  # by which the poses' clock is ahead of the camera's
    poses_scale: float = 1.0  # metres of one unit of the poses
    topics: Mapping[str, str] = field(default_factory=dict)
    selection: Selection = field(default_factory=Selection)
    use_imu: bool = True
    kept_index: Path | None = None  # a file that Sequence.index.save wrote, or that is not there yet
    progress: Progress = no_progress  # of what takes long


def opened(loader: Loader, path: Path, given: RecordingOptions, report: Report) -> Sequence:
    """Load a recording with all that was given; problems go to `report`."""
    options = load_options(loader, path, given)
    found = loader.load(path, options, report)
    if given.poses is not None:
        found = with_poses(found, given.poses, options, given.poses_time_offset_s, report)
    if given.poses_scale != 1.0:
        found = _in_metres(found, given)
    if given.use_imu and (given.imu or given.imu_from_camera or given.imu_time_offset_s):
        number = given.camera_number if loader.name == "folder" else None
        found = with_imu(found, given.imu, given.imu_from_camera, number, given.imu_time_offset_s)
    return selected(found, given.selection, report)


def _in_metres(found: Sequence, given: RecordingOptions) -> Sequence:
    """The recording with its poses' positions times `poses_scale`."""
    if found.world_from_camera is None:
        raise SequenceError(f"{found.root}: --poses-scale, but no poses are known: --poses FILE gives them")
    if given.camera_from_body is not None:
        raise SequenceError(f"{given.camera_from_body}: is in metres, so poses of a body must be, too: scale the file")
    scaled = (Pose(pose.rotation, given.poses_scale * pose.translation) for pose in found.world_from_camera)
    return replace(found, world_from_camera=tuple(scaled))


def load_options(loader: Loader, path: Path, given: RecordingOptions) -> LoadOptions:
    """The part that a loader must know; SequenceError for what does not go together."""
    if given.detections_path is not None and not given.detections_path.is_file():
        raise SequenceError(f"{given.detections_path}: no such detection file")
    _check_accepted(loader, path, given)
    return LoadOptions(
        camera_number=None if loader.name == "folder" and given.imu_from_camera is not None else given.camera_number,
        detections_path=given.detections_path,
        has_own_imu=given.use_imu and given.imu is None,
        has_own_poses=given.poses is None,
        poses_convention=given.poses_convention,
        camera_from_body=_body(loader, path, given),
        camera_file=given.camera_file,
        size=given.size,
        rate_hz=given.rate_hz,
        times_file=given.times_file,
        scene=given.scene,
        topics=given.topics,
        kept_index=given.kept_index,
    )


_FLAGS = {
    "camera_file": "--camera FILE",
    "size": "--size",
    "rate_hz": "--rate",
    "times_file": "--times FILE",
    "scene": "--scene",
    "topics": "--topic",
}


def _check_accepted(loader: Loader, path: Path, given: RecordingOptions) -> None:
    for name, flag in _FLAGS.items():
        if getattr(given, name) and name not in loader.accepts:
            other = ", or give --times FILE" if name == "rate_hz" and "times_file" in loader.accepts else ""
            raise SequenceError(
                f"{path}: {flag} is not for recordings of the layout {loader.name}: leave it out{other}"
            )
    if given.size is not None and given.camera_file is None:
        raise SequenceError(f"{path}: --size is the size of the images that --camera FILE is scaled to: give both")
    if given.rate_hz is not None and given.times_file is not None:
        raise SequenceError(f"{given.times_file}: --times FILE and --rate both say when frames are: give one of them")


def _body(loader: Loader, path: Path, given: RecordingOptions) -> Pose | None:
    if given.poses_convention not in CONVENTIONS:
        known = ", ".join(CONVENTIONS)
        raise SequenceError(f"unknown convention of poses {given.poses_convention!r:.60}, known are {known}")
    body = None if given.camera_from_body is None else read_camera_from_body(given.camera_from_body)
    if body is not None and given.poses_convention not in ("camera", "body"):
        raise SequenceError(
            f"{given.camera_from_body}: poses of a body are not of the convention {given.poses_convention}"
        )
    chosen = body is not None or given.poses_convention != "camera"
    if chosen and given.poses is None and "conventions" not in loader.accepts:
        raise SequenceError(
            f"{path}: the convention of poses can be chosen for poses.tum of a sequence folder, or --poses FILE, only"
        )
    return body
