"""The camera at each frame."""

from __future__ import annotations

from dataclasses import dataclass

from meshslam.geometry import Camera, Floats, Pose


@dataclass(frozen=True, eq=False)
class CameraPath:
    """One camera on its path; `frame_ids[i]` is the number of frame i in the detections."""

    camera: Camera
    frame_ids: tuple[int, ...]
    times_s: Floats  # (n,)
    world_from_camera: tuple[Pose, ...]
    height_above_ground_m: float | None

    def pose_of_frame(self) -> dict[int, Pose]:
        """Poses by frame number."""
        return dict(zip(self.frame_ids, self.world_from_camera, strict=True))
