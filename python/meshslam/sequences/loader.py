"""What a loader is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from meshslam.geometry import Pose
from meshslam.sequences.conventions import Convention, in_convention
from meshslam.sequences.report import Report
from meshslam.sequences.sequence import Sequence


@dataclass(frozen=True)
class LoadOptions:
    """What the user may choose about a recording, as far as its loader must know."""

    camera_number: int | None = None  # of layouts with several cameras; None: the layout's usual one
    detections_path: Path | None = None  # instead of the layout's own
    has_own_imu: bool = True  # False: the layout's IMU is not read, as other files take its place or none is needed
    has_own_poses: bool = True  # False: the layout's poses are not read, as a file takes their place
    poses_convention: Convention = "camera"  # of poses.tum
    camera_from_body: Pose | None = None  # poses.tum holds world_from_body
    camera_file: Path | None = None  # the camera of layouts that have none
    size: tuple[int, int] | None = None  # width, height of the images that the camera file's intrinsics become
    rate_hz: float | None = None  # of frames without times
    times_file: Path | None = None  # the frames' times, in place of their own
    scene: str | None = None  # of recordings of several: which one
    topics: Mapping[str, str] = field(default_factory=dict)  # of bags: which topic is the image, the IMU, …
    kept_index: Path | None = None  # of bags: where an earlier index may lie

    def world_from_camera(self, poses: tuple[Pose, ...]) -> tuple[Pose, ...]:
        """Poses of a file, as it means them."""
        if self.camera_from_body is not None:
            body_from_camera = self.camera_from_body.inverse()
            return tuple(pose @ body_from_camera for pose in poses)
        return in_convention(poses, self.poses_convention)


class Loader(Protocol):
    """Reads one layout."""

    @property
    def name(self) -> str:
        """The layout's name, as `--layout` takes it."""

    @property
    def looks_for(self) -> str:
        """What a recording of this layout is known by, in words."""

    @property
    def accepts(self) -> frozenset[str]:
        """Which of camera_file, size, rate_hz, times_file, scene, topics, conventions this layout can use."""

    def recognizes(self, path: Path) -> bool:
        """Whether the folder or file looks like this layout; reads no more than a file's first bytes."""

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """List the images that are files, by frame; empty where there need be none; SequenceError where there must."""

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read all but the images; every problem goes to `report`, SequenceError is raised where nothing is left."""
