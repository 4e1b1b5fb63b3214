"""What SLAM runs on: the IMU, the recording's poses as odometry, or its images alone; and how it starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.localization.config import LocalizationConfig, SlamConfig
from meshslam.localization.gauge import Path, world_from_free
from meshslam.localization.imu import Mounting, NavState, check_imu
from meshslam.localization.inertial import first_velocity, inertial_path, start_state
from meshslam.localization.motion import ImageMotion, ImuMotion, MotionSource, OdometryMotion, slam_imu
from meshslam.localization.pictures import Pictures, pictures_of
from meshslam.localization.rough_start import RoughStart, rough_start, rough_start_by_images
from meshslam.localization.start import Estimator, loose, settled
from meshslam.perception import DetectionSet
from meshslam.sequences import ImuSamples, Sequence

NO_IMU = ImuSamples(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class SlamInput:
    """A recording with what moves the camera from frame to frame."""

    sequence: Sequence
    detections: DetectionSet
    imu: ImuSamples  # none by odometry or images
    mounting: Mounting
    motion: MotionSource
    pictures: Pictures | None
    slam: SlamConfig
    alone: str  # what a path without objects is called: "IMU alone", "odometry alone"; empty by images

    def path_alone(self, start: NavState, config: LocalizationConfig, world: Pose) -> Path:
        """The path without objects in the recording's world; empty by images alone."""
        times, poses = self.sequence.times_s, self.sequence.world_from_camera
        if isinstance(self.motion, ImuMotion):
            return tuple(world @ p for p in inertial_path(self.imu, times, start, self.mounting, config.imu))
        return poses if isinstance(self.motion, OdometryMotion) and poses is not None else ()

    def world(self, first_camera: Pose) -> Pose:
        """The recording's world from the one of the run, whose first pose is given."""
        known_start = self.sequence.initial_state is not None or isinstance(self.motion, OdometryMotion)
        return Pose.identity() if known_start else world_from_free(self.sequence, first_camera)


def slam_input(sequence: Sequence, detections: DetectionSet, config: LocalizationConfig, slam: SlamConfig) -> SlamInput:
    """Choose what there is; SequenceError in clear words where nothing moves the camera."""
    pictures = pictures_of(sequence, detections, slam.points)
    fixed = replace(slam, time_offset_sigma_s=1e-6, extrinsic_rotation_sigma_deg=1e-4)  # the camera is its own IMU
    itself = Mounting(Pose.identity())
    if slam.poses == "odometry":
        if sequence.world_from_camera is None:
            raise SequenceError(
                f"{sequence.root}: --poses odometry, but no poses are known: poses.tum in a sequence folder, OXTS in "
                "KITTI raw, poses/NN.txt in KITTI odometry"
            )
        odometry = OdometryMotion(sequence.world_from_camera, slam.odometry)
        return SlamInput(sequence, detections, NO_IMU, itself, odometry, pictures, fixed, "odometry alone")
    if sequence.imu is None and pictures is not None:
        seen = ImageMotion(pictures, sequence.camera, slam.odometry)
        sequence = replace(sequence, initial_state=None)
        return SlamInput(sequence, detections, NO_IMU, itself, seen, pictures, fixed, "")
    if sequence.imu is None:
        raise SequenceError(
            f"{sequence.root}: nothing tells how the camera moves: there is no IMU (imu.csv, oxts, or --imu FILE), and "
            "there are no images to do without; known poses can be used as odometry (--poses odometry)"
        )
    imu, imu_from_camera = check_imu(sequence, config.imu)
    turned = slam_imu(config.imu, slam)
    mounting = Mounting(imu_from_camera)
    return SlamInput(sequence, detections, imu, mounting, ImuMotion(turned), pictures, slam, "IMU alone")


def slam_start(
    given: SlamInput,
    heights_m: dict[str, float],
    fresh: Callable[[LocalizationConfig], Estimator],
    config: LocalizationConfig,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[NavState, LocalizationConfig]:
    """The first state, and the settings to begin with it."""
    sequence = given.sequence
    if isinstance(given.motion, OdometryMotion):
        assert sequence.world_from_camera is not None
        velocity = first_velocity(sequence.times_s, sequence.world_from_camera)
        first_s, zero = float(sequence.times_s[0]), np.zeros(3)
        return NavState(first_s, sequence.world_from_camera[0], velocity, zero, zero), config
    if sequence.initial_state is not None:
        return start_state(sequence, given.imu, given.mounting.imu_from_camera), config
    rough = _rough(given, heights_m, config)
    free = loose(config, float(np.linalg.norm(rough.state.velocity_in_world)))
    lag_s = given.slam.lag_s
    return settled(sequence, given.imu, given.detections, rough.state, fresh, free, lag_s, progress), free


def _rough(given: SlamInput, heights_m: dict[str, float], config: LocalizationConfig) -> RoughStart:
    sequence, alignment = given.sequence, config.alignment
    sized = [(d, heights_m[d.category]) for d in given.detections.detections if d.category in heights_m]
    if isinstance(given.motion, ImageMotion):
        return rough_start_by_images(sequence, given.motion.pictures, sized, config.imu.gravity_m_s2, alignment)
    return rough_start(sequence, given.imu, given.mounting.imu_from_camera, sized, config.imu, alignment)
