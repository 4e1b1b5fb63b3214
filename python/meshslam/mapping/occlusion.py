"""What stands before an object in a frame: nearer detections, and nearer mapped objects without a detection."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from meshslam.geometry import Camera, Pose, render
from meshslam.geometry.arrays import Bytes, Floats, Ints
from meshslam.perception import Detection


@dataclass(frozen=True, eq=False)
class Placed:
    """An object whose place is known already."""

    world_from_object: Pose
    vertices: Floats
    faces: Ints


@dataclass(frozen=True, eq=False)
class Occluders:
    """Depth order of what each frame shows: by 3-D estimates where there are any, else by the masks' lowest row."""

    camera: Camera
    detections_of_frame: Mapping[int, tuple[Detection, ...]]
    world_from_camera_of_frame: Mapping[int, Pose]
    placed: Mapping[int, Placed] = field(default_factory=dict)  # by track

    def before(self, detection: Detection) -> Bytes:
        """Mask (h, w) of what stands before the detection's object."""
        mask = np.zeros((self.camera.height, self.camera.width), np.uint8)
        for other in self.detections_of_frame[detection.frame]:
            if other.id != detection.id and _touch(other, detection) and self._nearer(other, detection):
                mask |= other.mask()
        for thing in self._unseen(detection):
            mask |= thing
        return mask

    def _depth_m(self, track: int | None, frame: int) -> float | None:
        if track is None or track not in self.placed:
            return None
        camera_from_world = self.world_from_camera_of_frame[frame].inverse()
        return float(camera_from_world.transform(self.placed[track].world_from_object.translation)[2])

    def _nearer(self, other: Detection, detection: Detection) -> bool:
        a, b = self._depth_m(other.track_id, other.frame), self._depth_m(detection.track_id, detection.frame)
        if a is not None and b is not None:
            return a < b
        return _lowest_row(other) > _lowest_row(detection)

    def _unseen(self, detection: Detection) -> list[Bytes]:
        """Masks of nearer mapped objects that have no detection in the frame."""
        depth = self._depth_m(detection.track_id, detection.frame)
        if depth is None:
            return []
        seen = {d.track_id for d in self.detections_of_frame[detection.frame]}
        camera_from_world = self.world_from_camera_of_frame[detection.frame].inverse()
        masks = []
        for track, thing in sorted(self.placed.items()):
            away = self._depth_m(track, detection.frame)
            if track in seen or away is None or not -1.0 < away < depth:
                continue
            pose = camera_from_world @ thing.world_from_object
            if _within(self.camera, pose.transform(thing.vertices), detection):
                masks.append(render(self.camera, [(pose, thing.vertices, thing.faces)]).mask)
        return masks


def _lowest_row(detection: Detection) -> tuple[float, float]:
    """Order of nearness on the ground: the lowest row, then the size (boxes cut by the image's lower edge)."""
    return round(detection.bbox[1] + detection.bbox[3], 1), detection.bbox[2] * detection.bbox[3]


def _touch(one: Detection, other: Detection, margin_px: float = 8.0) -> bool:
    """Whether two boxes meet, or nearly."""
    (ax, ay, aw, ah), (bx, by, bw, bh) = one.bbox, other.bbox
    apart_x = max(ax, bx) - min(ax + aw, bx + bw)
    apart_y = max(ay, by) - min(ay + ah, by + bh)
    return max(apart_x, apart_y) < margin_px


def _within(camera: Camera, points_in_camera: Floats, detection: Detection) -> bool:
    """Whether points before the camera may project into the detection's box."""
    front = points_in_camera[points_in_camera[:, 2] > 0.1]
    if len(front) == 0:
        return False
    pixels = camera.project(front)
    x, y, w, h = detection.bbox
    low, high = pixels.min(0), pixels.max(0)
    return bool(low[0] < x + w and high[0] > x and low[1] < y + h and high[1] > y)
