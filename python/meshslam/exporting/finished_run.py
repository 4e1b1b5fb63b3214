"""What lies in a run's folder, read for an export."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from meshslam.errors import MapError
from meshslam.geometry import Bytes, Camera, Floats, Pose
from meshslam.maps import Map, TiledMap, Trajectory, TrajectoryEstimate
from meshslam.perception import Detection, DetectionSet, read_detections
from meshslam.sequences import read_camera_file

_NO_CAMERA = Camera(1, 1, 1.0, 1.0, 0.5, 0.5)  # of a map, which has no frames that it would be used for


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """A run's map, path, camera and detections; `read_image` gives an image (h, w, 3), BGR, by its frame's index.

    Example:
        run = FinishedRun.load(Path("run"))
        run.scene[3].vertices_in_world, run.path.positions_in_world

    """

    name: str
    scene: Map
    path: Trajectory
    frame_ids: tuple[int, ...]
    camera: Camera
    estimate: TrajectoryEstimate | None = None
    detections: DetectionSet | None = None
    read_image: Callable[[int], Bytes] | None = None
    notes: tuple[str, ...] = ()
    tiled: TiledMap | None = None  # the map, where a map in tiles is all that there is

    @staticmethod
    def load(folder: Path) -> FinishedRun:
        """Read a run's folder; MapError, naming the file, if it is none, or if a file is damaged.

        A run of `localize` has no map of its own: its scene is empty, and `notes` says so. Of a map in tiles nothing is
        read yet: `whole` has its objects.
        """
        folder = Path(folder)
        if TiledMap.is_at(folder):
            city, no_path = TiledMap.open(folder), Trajectory(np.zeros(0), ())
            empty = [] if len(city) else [f"no objects: {folder} is an empty map in tiles"]
            return FinishedRun(folder.resolve().name, Map(()), no_path, (), _NO_CAMERA, notes=tuple(empty), tiled=city)
        if not (folder / "trajectory.tum").is_file():
            raise MapError(f"{folder}: is no finished run: it holds no trajectory.tum: give the folder of --out")
        path, notes = Trajectory.load(folder / "trajectory.tum"), []
        estimate = None
        if (folder / "trajectory.csv").is_file():
            estimate = TrajectoryEstimate.load(folder / "trajectory.csv")
        has_map = (folder / "map.json").is_file()
        if not has_map:
            notes.append("no objects: the run has no map.json (a run of localize has its map elsewhere)")
        found = None
        if (folder / "detections.json").is_file():
            found = read_detections(folder / "detections.json")
        frame_ids, said = _frame_ids(path, estimate, found)
        return FinishedRun(
            folder.resolve().name,
            Map.load(folder) if has_map else Map(()),
            path,
            frame_ids,
            read_camera_file(folder / "camera.yaml").camera,
            estimate,
            found,
            notes=(*notes, *said),
        )

    def whole(self) -> FinishedRun:
        """The same with all objects of a map in tiles."""
        return self if self.tiled is None else replace(self, scene=self.tiled.loaded())

    def with_images(self, read_image: Callable[[int], Bytes] | None) -> FinishedRun:
        """The same with images."""
        return replace(self, read_image=read_image)

    @property
    def times_ns(self) -> list[int]:
        """Times of the frames, nanoseconds."""
        return [round(1e9 * float(time_s)) for time_s in self.path.times_s]

    @property
    def covariances_in_world(self) -> Floats | None:
        """Covariances (n, 6, 6) of the poses as ROS has them; None where the run has none."""
        return None if self.estimate is None else self.estimate.covariances_in_world

    @cached_property
    def _by_frame(self) -> dict[int, tuple[Detection, ...]]:
        return {} if self.detections is None else self.detections.by_frame()

    def found_at(self, index: int) -> tuple[Detection, ...]:
        """Detections of a frame."""
        return self._by_frame.get(self.frame_ids[index], ())

    def image_name(self, index: int) -> str:
        """The file name of a frame's image: as in the detections, or its number."""
        names = {} if self.detections is None else self._names
        return names.get(self.frame_ids[index], f"{self.frame_ids[index]:06d}.png")

    @cached_property
    def _names(self) -> dict[int, str]:
        assert self.detections is not None
        return {image.id: image.file_name for image in self.detections.images}

    def camera_from_object(self, index: int, number: int) -> Pose:
        """An object's pose in a frame's camera."""
        return self.path.world_from_camera[index].inverse() @ self.scene[number].world_from_object


def _frame_ids(
    path: Trajectory, estimate: TrajectoryEstimate | None, found: DetectionSet | None
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """The frames' numbers, and what is to be said of them."""
    if estimate is not None and len(estimate) == len(path):
        return estimate.frame_ids, ()
    images = () if found is None else tuple(sorted(image.id for image in found.images))
    if len(images) == len(path):
        return images, ()
    said = f"frames are counted from 0: the run has {len(path)} poses, its detections are of {len(images)} images"
    return tuple(range(len(path))), (said,)


def positions_of(run: FinishedRun) -> Floats:
    """Camera centres (n, 3), metres; empty for a run without poses."""
    return np.asarray(run.path.positions_in_world, float).reshape(-1, 3)
