"""A drive to be merged: what its folder holds of map, path and views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from meshslam.errors import MapError
from meshslam.files import must_exist
from meshslam.geometry import Camera
from meshslam.maps import Map, Trajectory
from meshslam.perception import DetectionSet, read_detections
from meshslam.sequences import read_camera_file

_NEEDED = ("trajectory.tum", "detections.json", "camera.yaml")


@dataclass(frozen=True, eq=False)
class DriveViews:
    """The frames of a drive with what they show."""

    camera: Camera
    frame_ids: tuple[int, ...]  # frame i has pose i of the trajectory
    detections: DetectionSet
    height_above_ground_m: float | None


@dataclass(frozen=True, eq=False)
class Drive:
    """A run's map in its own world, with its path and its views where they are at hand."""

    name: str
    map: Map
    trajectory: Trajectory | None = None
    views: DriveViews | None = None

    @property
    def first_s(self) -> float | None:
        """When it began."""
        return None if self.trajectory is None or not len(self.trajectory) else float(self.trajectory.times_s[0])

    @property
    def last_s(self) -> float | None:
        """When it ended."""
        return None if self.trajectory is None or not len(self.trajectory) else float(self.trajectory.times_s[-1])


def read_drives(folders: Sequence[Path], *, allow_outside: bool = False) -> tuple[tuple[Drive, ...], tuple[str, ...]]:
    """The drives of run directories in the order of their times, and notes on what is not at hand.

    Times tell the order where no two drives overlap in time; else the order is that given. MapError, DetectionError or
    SequenceError, naming the file, for a run that is not there or damaged.
    """
    drives, notes = list[Drive](), list[str]()
    for folder, name in zip(folders, drive_names(folders), strict=True):
        drive, missing = _read(folder, name, allow_outside=allow_outside)
        drives.append(drive)
        if missing:
            notes.append(
                f"{name}: no {' and no '.join(missing)}: its cars are fused by their figures, not by its views"
            )
    return in_order(drives), tuple(notes)


def in_order(drives: Sequence[Drive]) -> tuple[Drive, ...]:
    """By time where no two overlap, else as given."""
    spans = [(d.first_s, d.last_s, d) for d in drives]
    known = [(a, b, d) for a, b, d in spans if a is not None and b is not None]
    by_time = sorted(known, key=lambda row: row[:2])
    apart = all(before[1] < after[0] for before, after in pairwise(by_time))
    return tuple(d for _, _, d in by_time) if apart and len(known) == len(drives) else tuple(drives)


def drive_names(folders: Sequence[Path]) -> list[str]:
    """The folders' names, with as many folders above as make them different; MapError for one that is given twice."""
    parts = [folder.absolute().parts for folder in folders]
    for depth in range(1, max(map(len, parts), default=1) + 1):
        names = ["/".join(part[-depth:]) for part in parts]
        if len(set(names)) == len(names):
            return names
    raise MapError(f"{folders[0]}: the same run is given twice: each drive counts once")


def _read(folder: Path, name: str, *, allow_outside: bool) -> tuple[Drive, list[str]]:
    must_exist(folder, "run directory", MapError)
    scene = Map.load(folder, allow_outside=allow_outside)
    missing = [file for file in _NEEDED if not (folder / file).is_file()]
    path = None if _NEEDED[0] in missing else Trajectory.load(folder / _NEEDED[0])
    if missing or path is None:
        return Drive(name, scene, path), missing
    found, camera = read_detections(folder / _NEEDED[1]), read_camera_file(folder / _NEEDED[2])
    frames = tuple(sorted(image.id for image in found.images))
    if len(frames) != len(path):
        raise MapError(
            f"{folder / 'trajectory.tum'}: {len(path)} poses, but detections.json has {len(frames)} images: "
            "a run's folder has one pose for each"
        )
    views = DriveViews(camera.camera, frames, found, camera.height_above_ground_m)
    return Drive(name, scene, path, views), []
