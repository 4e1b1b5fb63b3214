"""What stands before an object in a frame: nearer detections, and nearer mapped objects without a detection."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

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
        for other in self.detected_before(detection):
            mask |= self.mask_of(other)
        before = self.undetected_before(detection)
        return mask | render(self.camera, before).mask if before else mask

    def detected_before(self, detection: Detection) -> list[Detection]:
        """The detections that hide a detection's object."""
        return [d for d in self.detections if self._hides(d, detection)]

    def _hides(self, other: Detection, detection: Detection) -> bool:
        return other.id != detection.id and are_near(other, detection) and self._is_nearer(other, detection)

    def _is_nearer(self, other: Detection, detection: Detection) -> bool:
        a, b = self.depth_m.get(other.id), self.depth_m.get(detection.id)
        if a is not None and b is not None:
            return a < b
        return nearness_on_ground(other) > nearness_on_ground(detection)

    def undetected_before(self, detection: Detection) -> list[tuple[Pose, Floats, Ints]]:
        """The mapped objects without a detection that may hide a detection's object."""
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
        return self._frame(detection).occluder(detection)

    def differs(self, other: Occluders, detection: Detection) -> bool:
        """Whether by `other` something else stands before the detection's object."""
        one, two = self._frame(detection), other._frame(detection)
        if not one.undetected_before(detection) and not two.undetected_before(detection):
            hiding = [[d.id for d in frame.detected_before(detection)] for frame in (one, two)]
            if hiding[0] == hiding[1]:
                return False
        return not np.array_equal(one.occluder(detection), two.occluder(detection))

    def with_placed(self, placed: Mapping[int, Placed]) -> Occluders:
        """The same drive with other places known."""
        return replace(self, placed=placed)

    def _frame(self, detection: Detection) -> FrameOcclusion:
        """Who hides whom in the detection's frame, as far as it concerns this detection."""
        detections = self.detections_of_frame[detection.frame]
        camera_from_world = self.world_from_camera_of_frame[detection.frame].inverse()
        depths = {
            d.id: float((camera_from_world @ self.placed[d.track_id].world_from_object).translation[2])
            for d in detections
            if d.track_id is not None and d.track_id in self.placed
        }
        shown, depth = {d.track_id for d in detections}, depths.get(detection.id)
        near = [] if depth is None else self._reach.tracks_before(detection, camera_from_world, self.camera, depth)
        rest = [
            (camera_from_world @ thing.world_from_object, thing.vertices, thing.faces)
            for thing in (self.placed[t] for t in near if t not in shown)
        ]
        return FrameOcclusion(self.camera, detections, Detection.mask, depths, rest)

    @cached_property
    def _reach(self) -> _Reach:
        tracks = sorted(self.placed)
        things = [self.placed[t] for t in tracks]
        return _Reach(
            np.array(tracks, np.int64),
            np.array([thing.world_from_object.translation for thing in things]).reshape(-1, 3),
            np.array([np.linalg.norm(thing.vertices, axis=1).max() for thing in things]),
        )


@dataclass(frozen=True, eq=False)
class _Reach:
    """Placed objects as balls: of all those of a long drive few are before the camera."""

    tracks: Ints  # (n,), ascending
    centres: Floats  # (n, 3), in world
    radii: Floats  # (n,), metres

    def tracks_before(self, detection: Detection, camera_from_world: Pose, camera: Camera, depth_m: float) -> list[int]:
        """Tracks of all objects nearer than `depth_m` that may project onto the columns of the detection's box."""
        x, _, z = camera_from_world.transform(self.centres).T
        found = (z > _BEHIND_M - _NEAR_M) & (z < depth_m + _NEAR_M)
        if camera.skew == 0:
            left, right = (
                (detection.bbox[0] - camera.cx) / camera.fx,
                (sum(detection.bbox[::2]) - camera.cx) / camera.fx,
            )
            widest = max(abs(left), abs(right))
            found &= np.abs(x) - self.radii <= widest * (z + self.radii) + _NEAR_M
        chosen: list[int] = self.tracks[found].tolist()
        return chosen


def _may_cover(camera: Camera, points_in_camera: Floats, detection: Detection) -> bool:
    """Whether points before the camera may project into the detection's box."""
    front = points_in_camera[points_in_camera[:, 2] > _NEAR_M]
    if len(front) == 0:
        return False
    pixels = camera.project(front)
    x, y, w, h = detection.bbox
    low, high = pixels.min(0), pixels.max(0)
    return bool(low[0] < x + w and high[0] > x and low[1] < y + h and high[1] > y)
