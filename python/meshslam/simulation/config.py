"""One configuration of a simulated sequence, and how it becomes a folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from meshslam.errors import SequenceError
from meshslam.settings import Settings, setting
from meshslam.simulation.bodies import BodySource, procedural_bodies
from meshslam.simulation.motion import ImuNoise
from meshslam.simulation.recorded import PathFiles, recorded_street
from meshslam.simulation.recording import EXACT, ObserverConfig, write_recording
from meshslam.simulation.street import Street, StreetConfig, make_street, street_camera

_STREET = StreetConfig(bend_deg=10.0, moving_cars=2)


@dataclass(frozen=True)
class SimulationConfig(Settings):
    """Everything that decides a simulated sequence's bytes; paths are those of files to read."""

    seed: int = setting(0, low=0)  # the same seed and settings give the same bytes
    street: StreetConfig = _STREET
    imu_noise: ImuNoise = field(default_factory=ImuNoise)
    observer: ObserverConfig = field(default_factory=ObserverConfig)
    noise: bool = setting(False)  # detections as a network would see them, by `observer`; else exact
    keypoints: bool = setting(True)  # write key points, or leave them to the network
    known_poses: bool = setting(True)  # write poses.tum, or the truth alone
    poses: str | None = setting(None)  # camera path to drive: TUM, or KITTI's NN.txt
    times: str | None = setting(None)  # times of KITTI's poses, if not beside them
    imu: str | None = setting(None)  # samples (CSV) that were recorded on that path
    imu_from_camera: str | None = setting(None)  # how the recorded IMU is mounted: 4 × 4 in YAML or JSON
    start: int = setting(0, low=0)  # first pose of the file to use


DEMO = SimulationConfig(
    street=replace(_STREET, frames=24, cars_each_side=4, moving_cars=1, width_px=640, height_px=200, focal_px=380.0)
)


def simulate_street(
    config: SimulationConfig, folder: Path, progress: Callable[[str, int, int], None] | None = None
) -> Street:
    """Make the street and write its recording; the same configuration gives the same bytes."""
    street = make_world(config)
    seen = config.observer if config.noise else EXACT
    seen = ObserverConfig(**(vars(seen) | {"keypoints": config.keypoints}))
    write_recording(street, folder, seen, progress, config.imu_noise, known_poses=config.known_poses)
    return street


def make_world(config: SimulationConfig) -> Street:
    """The street alone; SequenceError where the files it is to follow do not go together."""
    street = config.street
    count = 2 * street.cars_each_side + street.moving_cars + street.turning_cars
    bodies: BodySource = procedural_bodies(config.seed, count)
    if config.poses is None:
        if config.imu is not None:
            raise SequenceError(f"{config.imu}: a recorded IMU needs the path it was recorded on: give --poses")
        return make_street(bodies, config.seed, config.street)
    names = (config.times, config.imu, config.imu_from_camera)
    times, imu, mounted = (None if name is None else Path(name) for name in names)
    files = PathFiles(Path(config.poses), times, imu, mounted, config.start)
    return recorded_street(bodies, config.seed, config.street, files, street_camera(config.street))
