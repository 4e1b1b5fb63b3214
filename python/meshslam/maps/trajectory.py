"""The camera's path."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.errors import MapError, SequenceError
from meshslam.files import write_atomically
from meshslam.geometry import Floats, Pose
from meshslam.sequences import Report, format_tum, read_tum


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The camera's trajectory: one time and one pose a frame, metres and seconds; MapError if their numbers differ.

    Example:
        path = meshslam.Trajectory.load("run/trajectory.tum")
        path.times_s, path.positions_in_world  # (n,) seconds, (n, 3) metres
        path.world_from_camera[0]  # Pose

    """

    times_s: Floats  # (n,), increasing
    world_from_camera: tuple[Pose, ...]

    def __post_init__(self) -> None:
        if len(self.times_s) != len(self.world_from_camera):
            raise MapError(
                f"a trajectory has one time a pose, found {len(self.times_s)} and {len(self.world_from_camera)}"
            )

    def __len__(self) -> int:
        return len(self.world_from_camera)

    @property
    def positions_in_world(self) -> Floats:
        """Camera centres (n, 3), metres."""
        return np.array([pose.translation for pose in self.world_from_camera]).reshape(-1, 3)

    def to_tum(self) -> bytes:
        """Format as `time tx ty tz qx qy qz qw` lines; MapError if a pose is not finite."""
        if (
            not all(np.isfinite(pose.matrix).all() for pose in self.world_from_camera)
            or not np.isfinite(self.times_s).all()
        ):
            raise MapError("a trajectory to be saved holds NaN or infinity")
        return format_tum(self.times_s, self.world_from_camera).encode()

    def save(self, path: Path | str) -> None:
        """Write a TUM file, whole or not at all; MapError if a pose is not finite, or the disk does not take it."""
        write_atomically(Path(path), self.to_tum())

    @staticmethod
    def load(path: Path | str) -> Trajectory:
        """Read a TUM file; MapError with the first line that is wrong."""
        try:
            return Trajectory(*read_tum(Path(path), Report()))
        except SequenceError as error:
            raise MapError(str(error)) from None
