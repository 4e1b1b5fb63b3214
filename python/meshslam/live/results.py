"""What the live pipeline tells: a pose for every frame, and counts of what was skipped."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from meshslam.geometry import Floats, Pose

WAITING: Literal["waiting"] = "waiting"
WINDOW: Literal["window"] = "window"
IMU: Literal["imu"] = "imu"


@dataclass(frozen=True, eq=False)
class LivePose:
    """One frame's pose, as it was known when its time was over."""

    frame: int
    time_s: float
    world_from_camera: Pose | None  # in the map; None while SLAM has not started
    covariance: Floats | None  # (6, 6) of it: right perturbation, (translation, rotation), m and rad
    velocity_in_world: Floats | None  # (3,), m/s, of the IMU
    latency_s: float  # from when the frame was given
    by: Literal[
        "window", "imu", "waiting"
    ]  # what the pose follows from: the frame's own features, or the IMU since then
    objects: tuple[int, ...] = ()  # ids in the map, of the objects that were observed with this frame
    notes: tuple[str, ...] = ()  # what was left out, and why
    map_from_odometry: Pose = field(
        default_factory=Pose.identity
    )  # changes when a loop closes: the pose in the odometry's world does not jump

    @property
    def odometry_from_camera(self) -> Pose | None:
        """The pose in a world that no loop closure moves (REP 105's odom)."""
        return None if self.world_from_camera is None else self.map_from_odometry.inverse() @ self.world_from_camera


@dataclass
class LiveCounts:
    """How many frames went where, so far."""

    frames: int = 0  # that were given
    taken_in: int = 0  # by the window
    skipped: int = 0  # by the window, which was busy; their poses follow from the IMU
    failed: int = 0  # that could not be taken in, as notes say
    segmented: int = 0
    perceptions_failed: int = 0  # whose image or detections could not be used
    too_late: int = 0  # segmented frames that had left the window
    waiting: int = 0  # poses of frames before SLAM had started
    by_window: int = 0  # poses
    by_imu: int = 0
    starts_failed: int = 0  # searches of a start that began anew, as notes say
    window_s: float = 0.0  # that the window took for frames after the start
    network_s: float = 0.0  # that perception took
    imu_left_out: int = 0  # samples that are no numbers, wild, or there already
    dropped_poses: int = 0  # that nobody took in time
    start_work_s: float = 0.0  # that finding the start took
    start_drive_s: float = 0.0  # of driving, from the first frame to the first pose
    latencies_s: array[float] = field(default_factory=lambda: array("f"), repr=False)  # of all poses after the start

    def latency_s(self, share: float) -> float:
        """The latency that a share of the poses keeps; 0 without poses."""
        return float(np.quantile(np.asarray(self.latencies_s), share)) if len(self.latencies_s) else 0.0

    @property
    def figures(self) -> dict[str, float]:
        """As metrics.json names them."""
        given = max(1, self.frames)
        return {
            "live_frames": self.frames,
            "live_frames_taken_in": self.taken_in,
            "live_frames_skipped": self.skipped,
            "live_frames_failed": self.failed,
            "live_frames_segmented": self.segmented,
            "live_segmented_share": round(self.segmented / given, 6),
            "live_perceptions_failed": self.perceptions_failed,
            "live_segmented_too_late": self.too_late,
            "live_poses_waiting": self.waiting,
            "live_poses_by_window": self.by_window,
            "live_poses_by_imu": self.by_imu,
            "live_imu_samples_left_out": self.imu_left_out,
            "live_poses_dropped": self.dropped_poses,
            "live_latency_median_s": round(self.latency_s(0.5), 6),
            "live_latency_p95_s": round(self.latency_s(0.95), 6),
            "live_latency_max_s": round(self.latency_s(1.0), 6),
            "live_window_s_per_frame": round(self.window_s / max(1, self.taken_in), 6),
            "live_perception_s_per_frame": round(self.network_s / max(1, self.segmented), 6),
            "live_starts_failed": self.starts_failed,
            "live_start_work_s": round(self.start_work_s, 6),
            "live_start_drive_s": round(self.start_drive_s, 6),
        }
