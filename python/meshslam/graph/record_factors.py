"""From records to GTSAM's factors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import gtsam
import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.graph.config import StartConfig
from meshslam.graph.displacement_factor import displacement_factor
from meshslam.graph.object_factor import CameraMemo
from meshslam.graph.records import Kind, Record
from meshslam.graph.road_factor import road_factor
from meshslam.graph.start_factors import start_pose_factor
from meshslam.graph.window import Entry, Window, linear_factor
from meshslam.motion import ImuNoise, Readings

Factor = gtsam.NonlinearFactor


class Cameras(Protocol):
    """The frames' cameras, as far as factors need them."""

    @property
    def arm_m(self) -> Floats:
        """The camera's centre (3,) in the IMU's frame."""

    def memo(self, frame: int) -> CameraMemo:
        """The camera of a frame."""


def add_record(window: Window, record: Record, cameras: Cameras, tag: object = None) -> Entry:
    """Take the factor of a record into a window."""
    return window.add(factor_of(record, cameras), tag, record=record)


def factor_of(record: Record, cameras: Cameras) -> Factor:
    """The factor of a record; equal records give equal bits."""
    return _FACTORS[record.kind](record.keys, record.numbers, cameras)


def _imu(keys: tuple[int, ...], numbers: Floats, _: Cameras) -> Factor:
    noise = ImuNoise(*numbers[:5].tolist())
    readings = Readings(numbers[11:].reshape(-1, 7), numbers[5:11], noise)
    x_i, v_i, x_j, v_j, b_i, b_j = keys
    return gtsam.CombinedImuFactor(x_i, v_i, x_j, v_j, b_i, b_j, readings.preintegrated())


def _step(keys: tuple[int, ...], numbers: Floats, _: Cameras) -> Factor:
    return gtsam.BetweenFactorPose3(keys[0], keys[1], _pose3(numbers), _diagonal(numbers[12:]))


def _first_camera(keys: tuple[int, ...], numbers: Floats, cameras: Cameras) -> Factor:
    start = StartConfig(*numbers[12:].tolist())
    rows = numbers[:12].reshape(3, 4)
    x, v, e, t = keys
    memo = cameras.memo(gtsam.Symbol(x).index())
    return start_pose_factor(start, Pose(rows[:, :3], rows[:, 3]), (x, v, e, t), memo)


def _pose(keys: tuple[int, ...], numbers: Floats, _: Cameras) -> Factor:
    return gtsam.PriorFactorPose3(keys[0], _pose3(numbers), _diagonal(numbers[12:]))


def _vector(keys: tuple[int, ...], numbers: Floats, _: Cameras) -> Factor:
    noise = gtsam.noiseModel.Isotropic.Sigma(len(numbers) - 1, float(numbers[-1]))
    return gtsam.PriorFactorVector(keys[0], numbers[:-1], noise)


def _biases(keys: tuple[int, ...], numbers: Floats, _: Cameras) -> Factor:
    bias = gtsam.imuBias.ConstantBias(numbers[:3], numbers[3:6])
    return gtsam.PriorFactorConstantBias(keys[0], bias, _diagonal(numbers[6:]))


def _rotation(keys: tuple[int, ...], numbers: Floats, _: Cameras) -> Factor:
    noise = gtsam.noiseModel.Isotropic.Sigma(3, float(numbers[9]))
    return gtsam.PriorFactorRot3(keys[0], gtsam.Rot3(numbers[:9].reshape(3, 3)), noise)


def _size(keys: tuple[int, ...], numbers: Floats, _: Cameras) -> Factor:
    z, size = keys
    return linear_factor(z, np.eye(len(numbers)), size, -numbers[:, None])


def _road_height(keys: tuple[int, ...], numbers: Floats, cameras: Cameras) -> Factor:
    x, o = keys
    return road_factor(x, o, cameras.arm_m, *numbers.tolist())


def _displacement(keys: tuple[int, ...], numbers: Floats, cameras: Cameras) -> Factor:
    return displacement_factor(keys, cameras.arm_m, *numbers.tolist())


_FACTORS: dict[Kind, Callable[[tuple[int, ...], Floats, Cameras], Factor]] = {
    "imu": _imu,
    "step": _step,
    "first camera": _first_camera,
    "pose": _pose,
    "vector": _vector,
    "biases": _biases,
    "rotation": _rotation,
    "size": _size,
    "road height": _road_height,
    "displacement": _displacement,
}


def _pose3(numbers: Floats) -> gtsam.Pose3:
    rows = numbers[:12].reshape(3, 4)
    return gtsam.Pose3(gtsam.Rot3(rows[:, :3]), rows[:, 3])


def _diagonal(sigmas: Floats) -> Any:  # noqa: ANN401 # a noise model of GTSAM's
    return gtsam.noiseModel.Diagonal.Sigmas(sigmas)
