"""Factors as plain numbers: what they are made of when they come into a graph, and again when it is read back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.graph.config import StartConfig
from meshslam.motion import OURS_FROM_GTSAM, Readings, RelativeMotion, to_pose3

Kind = Literal[
    "imu",  # X, V of two frames, B of both: readings
    "step",  # X of two frames: the second in the first, sigmas
    "first camera",  # X, V, E, T: the camera's pose, how well it is known
    "pose",  # X or O: the pose, sigmas
    "vector",  # the vector, its sigma
    "biases",  # B: accelerometer and gyroscope, sigmas
    "rotation",  # E: the rotation, its sigma
    "size",  # Z, S: the scale direction
    "road height",  # X, O: metres below the camera, sigma
    "displacement",  # X of two frames: metres, sigma
]
KINDS: tuple[Kind, ...] = get_args(Kind)  # saved files have their numbers: new ones go to the end


@dataclass(frozen=True, eq=False)
class Record:
    """A factor's kind, its variables, and what it measures with its noise; `factor_of` makes it."""

    kind: Kind
    keys: tuple[int, ...]
    numbers: Floats  # (n,)


def imu_record(keys: tuple[int, ...], readings: Readings) -> Record:
    """Preintegrated samples between two frames: X, V of the first and the second, B of both."""
    noise = readings.noise
    densities = [noise.gyroscope, noise.accelerometer, noise.gyroscope_walk, noise.accelerometer_walk]
    told = np.array([noise.gravity_m_s2, *densities])
    return Record("imu", keys, np.concatenate([told, readings.biases, readings.steps.ravel()]))


def step_record(one: int, other: int, motion: RelativeMotion) -> Record:
    """The camera's relative motion between two X."""
    step = to_pose3(motion.first_from_second).matrix()[:3]
    return Record("step", (one, other), np.append(step, motion.sigmas[OURS_FROM_GTSAM]))


def first_camera_record(keys: tuple[int, ...], world_from_camera: Pose, start: StartConfig) -> Record:
    """Where the first camera stands."""
    sigmas = [start.position_sigma_m, start.rotation_sigma_deg, start.heading_sigma_deg]
    return Record("first camera", keys, np.append(world_from_camera.matrix[:3], sigmas))


def pose_record(key: int, pose: Pose, sigmas: Floats) -> Record:
    """A prior of a pose; `sigmas` (6,) in GTSAM's order."""
    return Record("pose", (key,), np.append(to_pose3(pose).matrix()[:3], sigmas))


def vector_record(key: int, vector: Floats, sigma: float) -> Record:
    """A prior of a vector."""
    return Record("vector", (key,), np.append(vector, sigma))


def biases_record(key: int, biases: Floats, sigmas: Floats) -> Record:
    """A prior of biases (6,), of accelerometer and gyroscope."""
    return Record("biases", (key,), np.append(biases, sigmas))


def rotation_record(key: int, rotation: Floats, sigma_rad: float) -> Record:
    """A prior of a rotation (3, 3)."""
    return Record("rotation", (key,), np.append(rotation, sigma_rad))
