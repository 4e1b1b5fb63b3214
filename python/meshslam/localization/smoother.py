"""The graph over a lag: IMU, mounting, objects (GTSAM's batch fixed-lag smoother)."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, E, O, T, V, X

from meshslam.geometry import Pose
from meshslam.geometry.arrays import Floats
from meshslam.localization.config import ImuConfig, StartConfig
from meshslam.localization.factors import CameraKeys, SeenObject, object_factor, place_camera
from meshslam.localization.gtsam_bridge import from_pose3, to_gtsam_covariance, to_pose3
from meshslam.localization.imu import Interval, Mounting, NavState

_ROTATION, _OFFSET = E(0), T(0)


@dataclass(frozen=True, eq=False)
class FrameEstimate:
    """What the smoother holds of a frame."""

    state: NavState
    world_from_camera: Pose


class Smoother:
    """States of the last seconds; frames are numbered from 0 in the order in which they come."""

    def __init__(self, imu: ImuConfig, start: StartConfig, mounting: Mounting, lag_s: float) -> None:
        self._imu, self._start, self._mounting = imu, start, mounting
        params = gtsam.LevenbergMarquardtParams()
        params.setMaxIterations(4)
        params.setRelativeErrorTol(1e-4)
        params.setAbsoluteErrorTol(1e-2)
        self._smoother = gtsam.BatchFixedLagSmoother(lag_s, params)
        self._lag_s = lag_s
        self._graph = gtsam.NonlinearFactorGraph()
        self._values = gtsam.Values()
        self._stamps: dict[int, float] = {}
        self._rates: dict[int, Floats] = {}  # measured angular rate at each frame
        self._times: dict[int, float] = {}
        self._objects: set[int] = set()
        self.frame = -1

    def begin(self, state: NavState, rate_rad_s: Floats) -> None:
        """The first frame: its state and the mounting, each with its prior."""
        self.frame = 0
        self._insert(0, state, rate_rad_s)
        rotation, position = np.radians(self._start.rotation_sigma_deg), self._start.position_sigma_m
        sigmas = np.array([rotation] * 3 + [position] * 3)
        bias_sigmas = np.array(
            [self._imu.accelerometer_bias_sigma_m_s2] * 3 + [self._imu.gyroscope_bias_sigma_rad_s] * 3
        )
        noise = gtsam.noiseModel
        self._graph.addPriorPose3(X(0), to_pose3(state.world_from_imu), noise.Diagonal.Sigmas(sigmas))
        velocity = noise.Isotropic.Sigma(3, self._start.velocity_sigma_m_s)
        self._graph.addPriorVector(V(0), state.velocity_in_world, velocity)
        bias = gtsam.imuBias.ConstantBias(state.accelerometer_bias, state.gyroscope_bias)
        self._graph.addPriorConstantBias(B(0), bias, noise.Diagonal.Sigmas(bias_sigmas))
        mounted = gtsam.Rot3(self._mounting.imu_from_camera.rotation)
        self._values.insert(_ROTATION, mounted)
        self._values.insert(_OFFSET, np.array([self._mounting.time_offset_s]))
        turn = noise.Isotropic.Sigma(3, np.radians(self._imu.extrinsic_rotation_sigma_deg))
        self._graph.addPriorRot3(_ROTATION, mounted, turn)
        offset = noise.Isotropic.Sigma(1, self._imu.time_offset_sigma_s)
        self._graph.addPriorVector(_OFFSET, np.array([self._mounting.time_offset_s]), offset)

    def advance(self, predicted: NavState, interval: Interval) -> None:
        """The next frame, tied to the last by its IMU samples."""
        i, j = self.frame, self.frame + 1
        self.frame = j
        self._insert(j, predicted, interval.angular_rate_rad_s)
        self._graph.add(gtsam.CombinedImuFactor(X(i), V(i), X(j), V(j), B(i), B(j), interval.measurements))

    def see(self, seen: SeenObject, number: int, world_from_object: Pose, covariance: Floats | None) -> None:
        """A view of an object in this frame; with a covariance (6, 6) its pose is estimated along."""
        key: Pose | int = world_from_object
        if covariance is not None:
            key = O(number)
            if number not in self._objects:
                self._objects.add(number)
                self._values.insert(key, to_pose3(world_from_object))
                prior = gtsam.noiseModel.Gaussian.Covariance(to_gtsam_covariance(covariance))
                self._graph.addPriorPose3(key, to_pose3(world_from_object), prior)
            self._stamps[key] = self._times[self.frame]
        self._graph.add(
            object_factor(seen, self._camera_keys(self.frame), self._arm, self._rate(self.frame), key)
        )

    def update(self) -> None:
        """Solve; states older than the lag become a prior."""
        now_s = self._times[self.frame]
        self._stamps[_ROTATION] = self._stamps[_OFFSET] = now_s
        self._smoother.update(self._graph, self._values, self._stamps)
        self._graph, self._values, self._stamps = gtsam.NonlinearFactorGraph(), gtsam.Values(), {}
        for frame in [f for f, t in self._times.items() if t < now_s - self._lag_s]:
            del self._times[frame], self._rates[frame]
        held = self._smoother.timestamps()
        self._objects = {n for n in self._objects if O(n) in held}

    @property
    def frames(self) -> list[int]:
        """The frames that are held."""
        return sorted(self._times)

    def estimate(self, frame: int) -> FrameEstimate:
        """A frame as it is now seen."""
        held = self._smoother
        bias = held.calculateEstimateConstantBias(B(frame))
        state = NavState(
            self._times[frame],
            from_pose3(held.calculateEstimatePose3(X(frame))),
            held.calculateEstimateVector(V(frame)),
            bias.accelerometer(),
            bias.gyroscope(),
        )
        mounting = self.mounting()
        camera = place_camera(
            state.world_from_imu,
            state.velocity_in_world,
            mounting.imu_from_camera,
            mounting.time_offset_s,
            self._rates[frame],
        )
        return FrameEstimate(state, camera.pose)

    def mounting(self) -> Mounting:
        """How the camera is mounted, as it is now seen."""
        turn = self._smoother.calculateEstimateRot3(_ROTATION).matrix()
        offset_s = float(self._smoother.calculateEstimateVector(_OFFSET)[0])
        return Mounting(Pose(turn, self._arm), offset_s)

    def pose_covariance(self, frame: int) -> Floats:
        """Covariance (6, 6) of world_from_imu, right perturbation, (translation, rotation)."""
        marginals = gtsam.Marginals(self._smoother.getFactors(), self._smoother.calculateEstimate())
        return to_gtsam_covariance(marginals.marginalCovariance(X(frame)))

    @property
    def _arm(self) -> Floats:
        return self._mounting.imu_from_camera.translation

    def _rate(self, frame: int) -> Floats:
        return self._rates[frame]

    def _camera_keys(self, frame: int) -> CameraKeys:
        return X(frame), V(frame), _ROTATION, _OFFSET

    def _insert(self, frame: int, state: NavState, rate_rad_s: Floats) -> None:
        self._values.insert(X(frame), to_pose3(state.world_from_imu))
        self._values.insert(V(frame), state.velocity_in_world)
        bias = gtsam.imuBias.ConstantBias(state.accelerometer_bias, state.gyroscope_bias)
        self._values.insert(B(frame), bias)
        self._times[frame], self._rates[frame] = state.time_s, rate_rad_s - state.gyroscope_bias
        for key in (X(frame), V(frame), B(frame)):
            self._stamps[key] = state.time_s
