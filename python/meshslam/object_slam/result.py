"""What SLAM found."""

from __future__ import annotations

from dataclasses import dataclass, field

from meshslam.geometry import Floats, Pose
from meshslam.mapping import ObjectMapping
from meshslam.maps import Map, Trajectory, TrajectoryEstimate
from meshslam.perception import DetectionSet


@dataclass(frozen=True, eq=False)
class SlamState:
    """What is known when a frame was taken in.

    `world_from_camera` is None while SLAM has not started: without a given start it collects the first seconds, finds
    the start from them, and then processes them at once.
    """

    frame: int
    time_s: float
    world_from_camera: Pose | None  # in the map: it jumps where a loop is closed
    world_from_odometry: Pose  # the jumps so far; their inverse before the pose gives a path without any
    velocity_in_world: Floats | None  # (3,), m/s, of the IMU, or of the camera where there is none
    objects: tuple[int, ...]  # ids in the map, of the objects that this frame shows
    loop_closures: int  # landmarks that turned out to be older ones, so far
    has_imu_gap: bool = False
    notes: tuple[str, ...] = ()  # what of the frame's samples and detections was left out, and why
    camera_covariance: Floats | None = None  # (6, 6) of world_from_camera, but for the last loop closure's

    @property
    def is_started(self) -> bool:
        """Whether there is a pose."""
        return self.world_from_camera is not None


@dataclass(frozen=True, eq=False)
class SlamResult:
    """Trajectory and map of a run, smoothed as a whole."""

    trajectory: Trajectory
    filtered: tuple[Pose, ...]  # world_from_camera as each was estimated when its frame was processed
    mapping: ObjectMapping  # the map, what was left out and why
    detections: DetectionSet  # tracks that show one object are one
    figures: dict[str, float]
    notes: tuple[str, ...] = ()
    refinement_s: float = 0.0  # what fitting the map along the smoothed path took
    world_from_graph: Pose = field(default_factory=Pose.identity)  # the result's world from the graph's
    alone: tuple[Pose, ...] = ()  # the path without objects: by IMU or odometry; empty by images alone
    alone_by: str = ""  # its name
    iterations: tuple[tuple[Pose, ...], ...] = field(default=())  # solver gradient: the path after each iteration
    estimate: TrajectoryEstimate | None = None  # the path with its uncertainty; None by the gradient solver

    @property
    def map(self) -> Map:
        """The objects."""
        return self.mapping.map
