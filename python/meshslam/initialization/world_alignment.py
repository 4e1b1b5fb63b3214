"""Between a recording's world and one whose z axis is against gravity, in which motion is estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshslam.geometry import Floats, Pose, cross_matrix
from meshslam.maps import Map
from meshslam.motion import first_velocity, mean_specific_force
from meshslam.sequences import WORLD_FROM_FIRST_CAMERA, ImuSamples, Sequence

Path = tuple[Pose, ...]


def world_from_levelled(sequence: Sequence, first_camera: Pose) -> Pose:
    """The recording's world from the levelled one of a start that was found, where `first_camera` is the first pose.

    The first known pose says where the recording begins: its place and heading, and all of its turn where the
    recording's world is no levelled one. Without known poses the found world stays, or takes the first camera's axes.
    """
    known = None if sequence.world_from_camera is None else sequence.world_from_camera[0]
    if not sequence.is_levelled:
        return (known or WORLD_FROM_FIRST_CAMERA) @ first_camera.inverse()
    if known is None:
        return Pose.identity()
    turn = Pose.from_yaw(_heading(known) - _heading(first_camera), np.zeros(3))
    return Pose(turn.rotation, known.translation - turn.transform(first_camera.translation))


def level_from_world(sequence: Sequence, imu: ImuSamples, imu_from_camera: Pose) -> Pose:
    """The turn that makes a recording's world a levelled one: its known poses and the mean specific force tell.

    The identity where the world is levelled already, or where no poses are known.
    """
    poses, times_s = sequence.world_from_camera, sequence.times_s
    if sequence.is_levelled or poses is None or len(poses) < 4:
        return Pose.identity()
    mean_force = mean_specific_force(imu, times_s, [p.rotation @ imu_from_camera.rotation.T for p in poses])
    gain = -first_velocity(-times_s[::-1], poses[::-1]) - first_velocity(times_s, poses)
    up = mean_force - gain / (times_s[-1] - times_s[0])
    return Pose(_shortest_turn(up / np.linalg.norm(up), np.array([0.0, 0.0, 1.0])), np.zeros(3))


def moved_sequence(sequence: Sequence, to_from_world: Pose) -> Sequence:
    """The recording with its known poses in another world."""
    poses = sequence.world_from_camera
    return sequence if poses is None else replace(sequence, world_from_camera=moved_path(poses, to_from_world))


def moved_map(scene: Map, to_from_world: Pose) -> Map:
    """The map in another world."""
    return replace(
        scene,
        objects=tuple(replace(o, world_from_object=to_from_world @ o.world_from_object) for o in scene.objects),
    )


def moved_path(poses: Path, to_from_world: Pose) -> Path:
    """Poses in another world."""
    return tuple(to_from_world @ pose for pose in poses)


def _heading(world_from_camera: Pose) -> float:
    """Angle of a camera's axis about z."""
    x, y, _ = world_from_camera.rotation[:, 2]
    return float(np.arctan2(y, x))


def _shortest_turn(one: Floats, other: Floats) -> Floats:
    """Rotation (3, 3) that takes a unit vector to another, neither being the other's opposite (Rodrigues)."""
    cross = cross_matrix(np.cross(one, other))
    turn: Floats = np.eye(3) + cross + cross @ cross / (1.0 + float(one @ other))
    return turn
