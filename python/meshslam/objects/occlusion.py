"""What stands before an object in a frame: nearer detections, and nearer mapped objects without a detection."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from meshslam.geometry import Bytes, Camera, Floats, Ints, Pose, render
from meshslam.perception import Detection, are_near, nearness_on_ground

_NEAR_M = 0.1  # points nearer to the image plane have no pixel
_BEHIND_M = -1.0  # depth of an object's origin below which none of it is in view


@dataclass(frozen=True, eq=False)
class Placed:
    """An object whose place is known already."""

    world_from_object: Pose
    vertices: Floats
    faces: Ints


@dataclass(frozen=True, eq=False)
class FrameOcclusion:
    """Who hides whom in one frame.

    Of two detections whose objects' depths are both known the nearer one hides the other; else the one whose mask
    reaches lower on the image does. Mapped objects that no detection shows hide what is behind them.
    """

    camera: Camera
    detections: Sequence[Detection]
    mask_of: Callable[[Detection], Bytes]
    depth_m: Mapping[int, float] = field(default_factory=dict)  # by detection, where its object's place is known
    undetected: Sequence[tuple[Pose, Floats, Ints]] = ()  # camera_from_object, vertices, faces

    def occluder(self, detection: Detection) -> Bytes:
        """Mask (h, w) of what stands before a detection's object."""
        mask = np.zeros((self.camera.height, self.camera.width), np.uint8)
        for other in self.detections:
            if other.id != detection.id and are_near(other, detection) and self._is_nearer(other, detection):
                mask |= self.mask_of(other)
        before = self._undetected_before(detection)
        return mask | render(self.camera, before).mask if before else mask

    def _is_nearer(self, other: Detection, detection: Detection) -> bool:
        a, b = self.depth_m.get(other.id), self.depth_m.get(detection.id)
        if a is not None and b is not None:
            return a < b
        return nearness_on_ground(other) > nearness_on_ground(detection)

    def _undetected_before(self, detection: Detection) -> list[tuple[Pose, Floats, Ints]]:
        depth = self.depth_m.get(detection.id)
        if depth is None:
            return []
        return [
            (pose, vertices, faces)
            for pose, vertices, faces in self.undetected
            if _BEHIND_M < pose.translation[2] < depth and _may_cover(self.camera, pose.transform(vertices), detection)
        ]


@dataclass(frozen=True, eq=False)
class Occluders:
    """Who hides whom in every frame of a drive, by the places of the objects that are known so far."""

    camera: Camera
    detections_of_frame: Mapping[int, tuple[Detection, ...]]
    world_from_camera_of_frame: Mapping[int, Pose]
    placed: Mapping[int, Placed] = field(default_factory=dict)  # by track

    def before(self, detection: Detection) -> Bytes:
        """Mask (h, w) of what stands before the detection's object."""
        detections = self.detections_of_frame[detection.frame]
        camera_from_world = self.world_from_camera_of_frame[detection.frame].inverse()
        shown = {d.track_id for d in detections}
        poses = {t: camera_from_world @ o.world_from_object for t, o in sorted(self.placed.items())}
        depths = {
            d.id: float(poses[d.track_id].translation[2])
            for d in detections
            if d.track_id is not None and d.track_id in poses
        }
        rest = [(pose, self.placed[t].vertices, self.placed[t].faces) for t, pose in poses.items() if t not in shown]
        return FrameOcclusion(self.camera, detections, Detection.mask, depths, rest).occluder(detection)


def _may_cover(camera: Camera, points_in_camera: Floats, detection: Detection) -> bool:
    """Whether points before the camera may project into the detection's box."""
    front = points_in_camera[points_in_camera[:, 2] > _NEAR_M]
    if len(front) == 0:
        return False
    pixels = camera.project(front)
    x, y, w, h = detection.bbox
    low, high = pixels.min(0), pixels.max(0)
    return bool(low[0] < x + w and high[0] > x and low[1] < y + h and high[1] > y)
