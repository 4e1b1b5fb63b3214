"""A street along a path that was really driven, with the IMU that was recorded on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshslam.errors import SequenceError
from meshslam.files import real_path
from meshslam.geometry import Camera, Floats, Pose
from meshslam.sequences import ImuSamples, Report, read_extrinsics, read_imu, read_path
from meshslam.simulation.bodies import BodySource
from meshslam.simulation.motion import MARGIN_S, ImuReadings, Motion
from meshslam.simulation.road import Road
from meshslam.simulation.street import Street, StreetConfig, furnished

_BEHIND_M, _AHEAD_M = 12.0, 112.0  # straight road before the path's begin and after its end
_AROUND = 3  # poses before and after the window that tell the speed at its start


@dataclass(frozen=True)
class PathFiles:
    """Where a path and its IMU are; what is None is looked for beside the others."""

    poses: Path  # TUM, or KITTI's twelve numbers a line
    times: Path | None = None  # one a line, for KITTI's
    imu: Path | None = None  # CSV
    imu_from_camera: Path | None = None
    start: int = 0  # first frame


def recorded_street(bodies: BodySource, seed: int, config: StreetConfig, files: PathFiles, camera: Camera) -> Street:
    """A street along poses from a file, `config.frames` of them; SequenceError, naming the file, if that cannot be.

    Without an IMU, KITTI's poses get their axes renamed and others are taken as they are, z up; with one, the world is
    turned so that gravity points down.
    """
    times_s, poses = read_path(files.poses, files.times or _beside(files.poses, _times_names(files.poses)))
    if files.start + 2 > len(poses):
        raise SequenceError(f"{files.poses}: has {len(poses)} poses, the street begins at {files.start}: lower --start")
    imu, mounted = _imu(files)
    world_from_given = Pose.identity() if imu is None or mounted is None else _levelled(times_s, poses, imu, mounted)
    last = min(files.start + config.frames, len(poses))
    around = slice(max(0, files.start - _AROUND), min(len(poses), last + _AROUND))
    level = [world_from_given @ pose for pose in poses[around]]
    level = _moved(level, level[files.start - around.start], config.camera_height_m)
    motion = Motion(times_s[around], level)
    chosen = tuple(level[files.start - around.start : last - around.start])
    road = road_along(np.array([pose.translation for pose in level]), chosen[0], config)
    street = furnished(bodies, seed, config, road, times_s[files.start : last], chosen, camera)
    if imu is None or mounted is None:
        return street
    first, end = street.times_s[0] - MARGIN_S, street.times_s[-1] + MARGIN_S
    keep = (imu.times_s >= first) & (imu.times_s <= end)
    cut = ImuSamples(imu.times_s[keep], imu.angular_rate_rad_s[keep], imu.specific_force_m_s2[keep])
    if len(cut.times_s) < 2:
        raise SequenceError(f"{files.imu}: no samples between {first:.3f} s and {end:.3f} s, where the frames are")
    return replace(street, imu=ImuReadings(cut, mounted, motion.velocity(float(street.times_s[0]))))


def road_along(path: Floats, first: Pose, config: StreetConfig) -> Road:
    """The road under a path (n, 3) of a camera that keeps to the right lane; its `along` is 0 at the first pose."""
    apart = np.concatenate([[True], np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1) > 0.05])
    points = path[apart] - [0.0, 0.0, config.camera_height_m]
    if len(points) < 2:
        ahead = first.rotation[:, 2] * [1.0, 1.0, 0.0]
        points = np.array([points[0], points[0] + ahead / np.linalg.norm(ahead)])
    ahead = np.gradient(points[:, :2], axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    middle = points + config.lane_m * np.column_stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(points))])
    before, after = (np.append(direction, 0.0) for direction in (ahead[0], ahead[-1]))
    line = np.concatenate([[middle[0] - _BEHIND_M * before], middle, [middle[-1] + _AHEAD_M * after]])
    road = Road(line)
    return Road(line, -float(road.along_of(first.translation[None])[0]))


def _moved(poses: list[Pose], first: Pose, height_m: float) -> list[Pose]:
    """The same path, its first pose above the origin, so that the road there is at z = 0."""
    shift = np.array([0.0, 0.0, height_m]) - first.translation
    return [Pose(pose.rotation, pose.translation + shift) for pose in poses]


def _levelled(times_s: Floats, poses: tuple[Pose, ...], imu: ImuSamples, imu_from_camera: Pose) -> Pose:
    """world_from_given: z along the mean specific force, less the speed that was gained."""
    inside = (imu.times_s >= times_s[0]) & (imu.times_s <= times_s[-1])
    if not inside.any():
        raise SequenceError(
            f"IMU and poses do not overlap: samples from {imu.times_s[0]:.3f} s to {imu.times_s[-1]:.3f} s, "
            f"poses from {times_s[0]:.3f} s to {times_s[-1]:.3f} s: another clock?"
        )
    nearest = np.clip(np.searchsorted(times_s, imu.times_s[inside]), 0, len(poses) - 1)
    turns = np.array([(pose @ imu_from_camera.inverse()).rotation for pose in poses])
    force = np.einsum("nij,nj->ni", turns[nearest], imu.specific_force_m_s2[inside]).mean(0)
    motion = Motion(times_s, poses)
    force -= (motion.velocity(times_s[-1]) - motion.velocity(times_s[0])) / (times_s[-1] - times_s[0])
    up = force / np.linalg.norm(force)
    forward = poses[0].rotation[:, 2]
    forward = forward - up * (up @ forward)
    forward /= np.linalg.norm(forward)
    return Pose(np.stack([forward, np.cross(up, forward), up]), np.zeros(3))


def _imu(files: PathFiles) -> tuple[ImuSamples | None, Pose | None]:
    if files.imu is None:
        return None, None
    mounted = files.imu_from_camera or _beside(files.poses, _EXTRINSICS) or _beside(files.imu, _EXTRINSICS)
    if mounted is None:
        raise SequenceError(
            f"{files.imu}: how is the IMU mounted? give --imu-from-camera FILE "
            f"(none of {', '.join(_EXTRINSICS)} lies beside it or the poses)"
        )
    return read_imu(files.imu, Report()), read_extrinsics(mounted)[0]


_EXTRINSICS = ("imu_from_camera.yaml", "imu_from_camera.json", "camera_from_imu.yaml", "camera_from_imu.json")


def _times_names(poses: Path) -> tuple[str, ...]:
    """What the times of KITTI's NN.txt may be called."""
    number = poses.stem
    return (f"times_{number}.txt", f"sequences/{number}/times.txt", f"{number}/times.txt", "times.txt")


def _beside(file: Path, names: tuple[str, ...]) -> Path | None:
    """The first of some files in the folder of another, or one folder up."""
    return next((path for path in _candidates(file, names) if path.is_file()), None)


def _candidates(file: Path, names: tuple[str, ...]) -> Iterator[Path]:
    folder = real_path(file).parent
    return (place / name for place in (folder, folder.parent) for name in names)
