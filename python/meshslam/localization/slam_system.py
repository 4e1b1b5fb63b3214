"""SLAM as a robot uses it: frame by frame, with results while it runs, saved and loaded."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from meshslam.categories import Category
from meshslam.geometry import Camera, Pose
from meshslam.geometry.arrays import Floats
from meshslam.localization.config import LocalizationConfig, SlamConfig
from meshslam.localization.imu import Mounting
from meshslam.localization.imu_buffer import ImuBuffer
from meshslam.localization.landmarks import Landmark
from meshslam.localization.slam import Slam
from meshslam.localization.slam_archive import slam_from_arrays, slam_to_arrays
from meshslam.localization.smoother import WholePath
from meshslam.localization.stream import Frame, Stream
from meshslam.localization.system_archive import read_archive, write_archive
from meshslam.mapping import MappingConfig, category_model
from meshslam.sequences import ImuSamples, InitialState

FORMAT = "meshslam-slam-1"


@dataclass(frozen=True, eq=False)
class SlamSystemConfig:
    """What a system is told once."""

    camera: Camera
    imu_from_camera: Pose
    category: Category
    start: InitialState
    keypoint_names: tuple[str, ...]  # of the category, in the order of the detections
    height_above_ground_m: float | None = None
    localization: LocalizationConfig = field(default_factory=LocalizationConfig)
    slam: SlamConfig = field(default_factory=SlamConfig)
    mapping: MappingConfig = field(default_factory=MappingConfig)


@dataclass(frozen=True, eq=False)
class SlamState:
    """Where the camera is in the map that it makes."""

    time_s: float
    world_from_camera: Pose  # in the map: it jumps where objects are known again
    world_from_odometry: Pose  # the jumps so far; their inverse before the pose gives a path without any
    velocity_in_world: Floats  # (3,), of the IMU, m/s
    objects: tuple[int, ...]  # landmarks that this frame shows
    known_again: int  # landmarks that turned out to be older ones, so far


class SlamSystem:
    """The camera among objects that are not known before; detections carry tracks."""

    def __init__(self, config: SlamSystemConfig) -> None:
        self._config = config
        self._slam = self._fresh()
        self._stream = Stream(config.start, config.imu_from_camera)

    def _fresh(self) -> Slam:
        c, mounting = self._config, Mounting(self._config.imu_from_camera)
        model, height = category_model(c.category), c.height_above_ground_m
        return Slam(c.camera, c.category, model, c.keypoint_names, mounting, height, c.localization, c.slam, c.mapping)

    def process(self, frame: Frame, imu_samples: ImuSamples) -> SlamState:
        """Take the next frame with the IMU samples since the last one; SequenceError if time does not go on."""
        imu, first = self._stream.take(frame, imu_samples)
        slam = self._slam
        if first is not None:
            report = slam.begin(frame.number, first, imu, frame.detections)
        else:
            report = slam.process(frame.number, frame.time_s, imu, frame.detections)
        turn = slam.odometer.map_from_odometry
        velocity = turn.rotation @ slam.state.velocity_in_world
        return SlamState(frame.time_s, report.world_from_camera, turn, velocity, report.objects, len(slam.same))

    def landmarks(self) -> tuple[Landmark, ...]:
        """All objects so far, each stay in view by itself."""
        return tuple(self._slam.landmarks.values())

    def finish(self) -> WholePath:
        """All frames so far, smoothed together; the run can go on."""
        return self._slam.finish()

    def save(self, path: Path) -> None:
        """Write the whole run (.npz): it goes on here, and where it is loaded, in the same way.

        What the run has seen is linear from here on, and views are let go.
        """
        imu, arrays = self._stream.samples_to_save(), slam_to_arrays(self._slam)
        write_archive(path, FORMAT, imu, arrays)
        self._slam = self._fresh()
        slam_from_arrays(self._slam, arrays)

    @staticmethod
    def load(path: Path, config: SlamSystemConfig) -> SlamSystem:
        """Go on where `save` was; MapError if the file is none of its."""
        imu, arrays = read_archive(path, FORMAT)
        system = SlamSystem(config)
        system._stream.imu = ImuBuffer(imu)
        slam_from_arrays(system._slam, arrays)
        system._stream.last_s = system._slam.state.time_s
        return system
