"""Whether a drive that did not map a car had its place in view: the car is drawn where it would have been."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from meshslam.geometry import Bools, Camera, Floats, Ints, Pose, render
from meshslam.maps import MapObject
from meshslam.merging.config import VisitConfig
from meshslam.merging.drives import Drive
from meshslam.merging.joint_views import views_of

Status = Literal["seen", "moved", "detected", "absent", "gone", "hidden", "not_in_view", "unknown"]
_Shown = Literal["free", "detected", "hidden", "outside"]  # what one frame says of a car's place
_NEAREST_M = 1.0  # depth below which a car is beside the camera, not before it
_DETECTED_IOU = 0.3  # of a detection with the car as it would be drawn: the car is there, though it was not mapped


@dataclass(frozen=True)
class Visit:
    """What a drive says of a car."""

    drive: int
    status: Status
    number: int | None = None  # the car's in the drive's own map
    apart_m: float | None = None  # from where the merged map has it
    frames: int = 0  # that were looked at, and show the place free or the car in it


def visit_without(
    drive: Drive, index: int, world_from_drive: Pose, thing: MapObject, config: VisitConfig, own: Sequence[MapObject]
) -> Visit:
    """The visit of a drive that did not map a car: absent, detected, hidden, not in view; unknown without its frames.

    `own` are the drive's own cars, in its world: they hide what is behind them.
    """
    if drive.views is None or drive.trajectory is None:
        return Visit(index, "unknown")
    drive_from_object = world_from_drive.inverse() @ thing.world_from_object
    shown = Counter(_shown(drive, k, drive_from_object, thing, config, own) for k in _frames(drive, config))
    free, detected, hidden = shown["free"], shown["detected"], shown["hidden"]
    if detected >= max(1, config.min_frames // 2) and detected >= free:
        return Visit(index, "detected", frames=detected)
    if free >= config.min_frames:
        return Visit(index, "absent", frames=free)
    return Visit(index, "hidden" if hidden >= config.min_frames else "not_in_view", frames=free)


def _frames(drive: Drive, config: VisitConfig) -> list[int]:
    """Frames so far apart, or so turned, that each shows something new."""
    poses = () if drive.trajectory is None else drive.trajectory.world_from_camera
    kept: list[int] = []
    for k, pose in enumerate(poses):
        step = poses[kept[-1]].local(pose) if kept else np.full(6, np.inf)
        moved, turn = float(np.linalg.norm(step[:3])), float(np.degrees(np.linalg.norm(step[3:])))
        if moved >= config.step_m or turn >= config.step_deg:
            kept.append(k)
    return kept


def _shown(
    drive: Drive, index: int, drive_from_object: Pose, thing: MapObject, config: VisitConfig, own: Sequence[MapObject]
) -> _Shown:
    views = views_of(drive)
    if drive.trajectory is None:
        return "outside"
    camera_from_drive = drive.trajectory.world_from_camera[index].inverse()
    at = camera_from_drive @ drive_from_object
    box = _box(views.camera, at.transform(thing.vertices), config)
    if box is None:
        return "outside"
    drawn = _drawn(views.camera, [(at, thing)], box)
    before = [(pose, o) for o in own if _is_before(pose := camera_from_drive @ o.world_from_object, at)]
    free, mapped = drawn & ~_drawn(views.camera, before, box), {o.id for o in own}
    left, top, width, height = box
    for detection in views.detections.by_frame().get(views.frame_ids[index], ()):
        mask = detection.mask()[top : top + height, left : left + width] > 0
        union = int((mask | drawn).sum()) + detection.area_px - int(mask.sum())
        is_other = detection.track_id in mapped or detection.category != thing.category
        if not is_other and int((mask & drawn).sum()) > _DETECTED_IOU * union:
            return "detected"
        free &= ~mask
    return "free" if free.sum() >= config.min_free_share * max(1, drawn.sum()) else "hidden"


def _box(camera: Camera, points: Floats, config: VisitConfig) -> tuple[int, int, int, int] | None:
    """The rectangle (x0, y0, width, height) of a car in the image; None if it is not well in view."""
    depth = points[:, 2]
    if depth.min() < _NEAREST_M or depth.mean() > config.max_distance_m:
        return None
    pixels = camera.project(points)
    inside = ((pixels >= 0) & (pixels < np.array([camera.width, camera.height]))).all(1)
    if inside.mean() < config.min_inside_share or np.ptp(pixels[:, 0]) < config.min_box_px:
        return None
    low = np.maximum(np.floor(pixels.min(0)).astype(int), 0)
    high = np.minimum(np.ceil(pixels.max(0)).astype(int) + 1, [camera.width, camera.height])
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def _drawn(camera: Camera, placed: Sequence[tuple[Pose, MapObject]], box: tuple[int, int, int, int]) -> Bools:
    meshes: list[tuple[Pose, Floats, Ints]] = [(pose, thing.vertices, thing.faces) for pose, thing in placed]
    if not meshes:
        return np.zeros((box[3], box[2]), bool)
    found: Bools = render(camera, meshes, box).object_index >= 0
    return found


def _is_before(camera_from_object: Pose, other: Pose) -> bool:
    """Whether an object stands before another, and not behind the camera."""
    return 0.0 < float(camera_from_object.translation[2]) < float(other.translation[2])
