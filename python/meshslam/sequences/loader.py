"""What a loader is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from meshslam.geometry import Pose
from meshslam.sequences.conventions import Convention, in_convention
from meshslam.sequences.report import Report
from meshslam.sequences.sequence import Sequence


@dataclass(frozen=True)
class LoadOptions:
    """What the user may choose about a recording."""

    camera_number: int | None = None  # of layouts with several cameras; None: the layout's usual one
    detections_path: Path | None = None  # instead of the layout's own
    has_own_imu: bool = True  # False: the layout's IMU is not read, as other files take its place or none is needed
    poses_convention: Convention = "camera"  # of poses.tum
    camera_from_body: Pose | None = None  # poses.tum holds world_from_body

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
        """What a folder of this layout is known by, in words."""

    def recognizes(self, path: Path) -> bool:
        """Whether the folder looks like this layout; opens no file."""

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """List the camera's images by frame; empty where the layout can do without; SequenceError where it cannot."""

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read all but the images; every problem goes to `report`, SequenceError is raised where nothing is left."""
