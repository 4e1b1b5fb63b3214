"""Localization as a robot uses it: frames with their IMU samples in, states out; saved and loaded as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshslam.geometry import Camera, Pose
from meshslam.geometry.arrays import Floats
from meshslam.localization.belief import SmootherBelief
from meshslam.localization.config import LocalizationConfig
from meshslam.localization.imu import Mounting
from meshslam.localization.imu_buffer import ImuBuffer
from meshslam.localization.known_objects import known_objects
from meshslam.localization.localizer import FrameReport, Localizer
from meshslam.localization.stream import Frame, Stream
from meshslam.localization.system_archive import read_archive, write_archive
from meshslam.maps import Map
from meshslam.sequences import ImuSamples, InitialState

FORMAT = "meshslam-system-1"


@dataclass(frozen=True, eq=False)
class SystemConfig:
    """What a system is told once."""

    camera: Camera
    imu_from_camera: Pose
    scene: Map
    start: InitialState
    keypoint_names: dict[str, tuple[str, ...]]  # by category, in the order of the detections
    localization: LocalizationConfig


@dataclass(frozen=True, eq=False)
class State:
    """Where the camera is."""

    time_s: float
    world_from_camera: Pose
    velocity_in_world: Floats  # (3,), of the IMU, m/s
    covariance: Floats  # (6, 6) of world_from_imu, right perturbation, (translation, rotation)
    objects: tuple[int, ...]  # of the map, seen in this frame
    moved: tuple[int, ...]  # objects that were found moved so far


class System:
    """The camera in a known map, frame by frame."""

    def __init__(self, config: SystemConfig) -> None:
        self._config = config
        self._localizer = Localizer(
            config.camera,
            known_objects(config.scene),
            Mounting(config.imu_from_camera),
            config.keypoint_names,
            config.localization,
        )
        self._stream = Stream(config.start, config.imu_from_camera)

    def process(self, frame: Frame, imu_samples: ImuSamples) -> State:
        """Take the next frame with the IMU samples since the last one; SequenceError if time does not go on."""
        imu, first = self._stream.take(frame, imu_samples)
        detections = tuple(frame.detections)
        if first is not None:
            report = self._localizer.begin(frame.number, first, imu, detections)
        else:
            report = self._localizer.process(frame.number, frame.time_s, imu, detections)
        return self._state(frame, report)

    def save(self, path: Path) -> None:
        """Write all that is believed now (.npz): the newest state with its joint covariance, and which objects moved.

        The smoothing of the last seconds ends here; what they say of the newest state is kept.
        """
        imu = self._stream.samples_to_save()
        belief = self._localizer.belief()
        moved = np.array(sorted(self._localizer.moved.items()), np.int64).reshape(-1, 2)
        write_archive(path, FORMAT, imu, {"moved": moved, **belief.arrays()})

    @staticmethod
    def load(path: Path, config: SystemConfig) -> System:
        """Go on where `save` ended; MapError if the file is none of its."""
        imu, arrays = read_archive(path, FORMAT)
        system = System(config)
        system._stream.imu = ImuBuffer(imu)
        system._localizer.moved = {int(n): int(f) for n, f in arrays.pop("moved")}
        belief = SmootherBelief.from_arrays(arrays)
        system._stream.last_s = belief.state.time_s
        system._localizer.resume(belief)
        return system

    def _state(self, frame: Frame, report: FrameReport) -> State:
        velocity, covariance = self._localizer.velocity_and_covariance
        seen = tuple(sorted(report.object_of_detection.values()))
        moved = tuple(sorted(self._localizer.moved))
        return State(frame.time_s, report.corrected, velocity, covariance, seen, moved)
