"""The camera's variables in the window: pose, velocity and biases of each frame's IMU, and the mounting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from meshslam.geometry import Floats, Pose, cross_matrix
from meshslam.graph.camera_covariance import camera_covariance
from meshslam.graph.camera_prediction import CameraPrediction
from meshslam.graph.object_factor import CameraKeys, CameraMemo, CameraPlace
from meshslam.graph.start_factors import OFFSET, ROTATION
from meshslam.graph.window import Window
from meshslam.motion import Mounting, NavState, from_pose3, to_gtsam_covariance, to_pose3


@dataclass(frozen=True, eq=False)
class FrameEstimate:
    """What the window holds of a frame."""

    state: NavState
    world_from_camera: Pose
    camera_velocity: Floats  # (3,), in the world

    @property
    def motion(self) -> Floats:
        """The camera's velocity, and the biases of accelerometer and gyroscope (9,)."""
        return np.concatenate([self.camera_velocity, self.state.accelerometer_bias, self.state.gyroscope_bias])


@dataclass(frozen=True, eq=False)
class FrameCovariance:
    """Covariances (6, 6) of a frame's poses: right perturbations, (translation, rotation), m and rad."""

    world_from_imu: Floats
    world_from_camera: Floats  # pose, velocity and mounting of the IMU count with their correlations


class CameraStates:
    """States of the frames that a window holds; frames are numbered from 0 in their order."""

    def __init__(self, window: Window, mounting: Mounting) -> None:
        self.newest = -1
        self.rates_rad_s: dict[int, Floats] = {}  # angular rate at each frame that is kept, free of bias
        self._window, self._mounting = window, mounting
        self._times_s: dict[int, float] = {}  # of the frames that are held
        self._memos: dict[int, CameraMemo] = {}
        self._final: dict[int, Pose] = {}  # world_from_camera of each frame as it was when it left the window
        self._estimates: dict[int, FrameEstimate] = {}  # those that were asked for at the values `_estimated_at`
        self._estimated_at: gtsam.Values | None = None

    @property
    def held(self) -> list[int]:
        """The frames in the window."""
        return sorted(self._times_s)

    @property
    def arm_m(self) -> Floats:
        """The camera's centre (3,) in the IMU's frame."""
        return self._mounting.imu_from_camera.translation

    def time_s(self, frame: int) -> float:
        """Time of a frame that is held."""
        return self._times_s[frame]

    def holds(self, frame: int) -> bool:
        """Whether a frame is in the window."""
        return frame in self._times_s

    def older_than(self, time_s: float) -> list[int]:
        """Frames of the window before a time."""
        return [f for f, t in self._times_s.items() if t < time_s]

    def keys(self, frame: int) -> CameraKeys:
        """The variables that place a frame's camera."""
        return X(frame), V(frame), ROTATION, OFFSET

    def memo(self, frame: int) -> CameraMemo:
        """The camera of a frame at the last values asked for."""
        return self._memos[frame]

    def insert(self, frame: int, state: NavState, rate_rad_s: Floats) -> None:
        """Add a frame's variables; the rate (3,) is as measured."""
        values = self._window.values
        values.insert(X(frame), to_pose3(state.world_from_imu))
        values.insert(V(frame), state.velocity_in_world)
        values.insert(B(frame), gtsam.imuBias.ConstantBias(state.accelerometer_bias, state.gyroscope_bias))
        self.newest = frame
        self._times_s[frame], self.rates_rad_s[frame] = state.time_s, rate_rad_s - state.gyroscope_bias
        self._memos[frame] = CameraMemo(self.arm_m, self.rates_rad_s[frame])
        self._estimates.pop(frame, None)

    def insert_mounting(self, mounting: Mounting) -> None:
        """Add the mounting's variables."""
        self._mounting, values = mounting, self._window.values
        self._estimates.clear()
        values.insert(ROTATION, gtsam.Rot3.ClosestTo(mounting.imu_from_camera.rotation))
        values.insert(OFFSET, np.array([mounting.time_offset_s]))

    def estimate(self, frame: int) -> FrameEstimate:
        """The current estimate of a frame that is held."""
        if self._window.values is not self._estimated_at:
            self._estimates.clear()
            self._estimated_at = self._window.values
        found = self._estimates.get(frame)
        if found is None:
            found = self._estimates[frame] = self._estimate(frame)
        return found

    def _estimate(self, frame: int) -> FrameEstimate:
        values = self._window.values
        bias = values.atConstantBias(B(frame))
        pose, velocity = from_pose3(values.atPose3(X(frame))), values.atVector(V(frame))
        state = NavState(self._times_s[frame], pose, velocity, bias.accelerometer(), bias.gyroscope())
        rate = self.rates_rad_s[frame]
        swing = pose.rotation @ cross_matrix(rate) @ self.arm_m
        return FrameEstimate(state, self.mounting().world_from_camera(state, rate), velocity + swing)

    def world_from_camera(self, frame: int) -> Pose:
        """The camera of any frame that is kept: the current estimate, or the last one before the frame left."""
        return self._final[frame] if frame in self._final else self.estimate(frame).world_from_camera

    def mounting(self) -> Mounting:
        """The current estimate of how the camera is mounted."""
        values = self._window.values
        return Mounting(Pose(values.atRot3(ROTATION).matrix(), self.arm_m), float(values.atVector(OFFSET)[0]))

    def pose_covariance(self, frame: int) -> Floats:
        """Covariance (6, 6) of world_from_imu, right perturbation, (translation, rotation)."""
        return to_gtsam_covariance(self._window.covariance(X(frame)))

    def covariances(self, frames: Sequence[int]) -> dict[int, FrameCovariance]:
        """Covariances of the poses of frames that are held, as the last `optimize` linearized all factors."""
        groups = [self.keys(frame) for frame in frames]
        joint = self._window.joint_covariances(groups, [key for group in groups for key in group])
        return {
            f: FrameCovariance(to_gtsam_covariance(found[:6, :6]), camera_covariance(self.place_of(f), found))
            for f, found in zip(frames, joint, strict=True)
        }

    def prediction(self) -> CameraPrediction:
        """The newest frame as the next cameras are predicted from it, as the last `optimize` linearized all factors."""
        keys = self.keys(self.newest)
        (joint,) = self._window.joint_covariances([keys], keys)
        return CameraPrediction(self.estimate(self.newest).state, self.mounting(), joint)

    def place_of(self, frame: int) -> CameraPlace:
        """The camera of a frame with its derivatives over the frame's variables."""
        return self._memos[frame].place(self._window.values, self.keys(frame))

    def place(self, world_from_camera: Pose) -> None:
        """Begin the search of the newest frame's pose at this camera pose."""
        moved = world_from_camera @ self.estimate(self.newest).world_from_camera.inverse()
        key = X(self.newest)
        self._window.values.update(key, to_pose3(moved @ from_pose3(self._window.values.atPose3(key))))
        self._estimates.pop(self.newest, None)
        self._memos[self.newest].forget()

    def retire(self, frames: list[int], *, keep: bool) -> set[int]:
        """Frames leave the window, their last estimates are kept or not. Returns their variables."""
        for frame in frames:
            if keep:
                self._final[frame] = self.estimate(frame).world_from_camera
            else:
                del self.rates_rad_s[frame]
        self.drop(frames)
        return {key for f in frames for key in (X(f), V(f), B(f))}

    def drop(self, frames: list[int]) -> None:
        """Forget frames that are not in the window any more."""
        for frame in frames:
            del self._times_s[frame], self._memos[frame]
            self._estimates.pop(frame, None)

    def to_arrays(self) -> dict[str, Floats]:
        """All but the variables, as plain arrays."""
        return {
            "rates": np.array([[f, *rate] for f, rate in self.rates_rad_s.items()]),
            "times": np.array([[f, t] for f, t in self._times_s.items()]),
            "cameras": np.array([pose.matrix for pose in self._final.values()]).reshape(-1, 4, 4),
            "camera_frames": np.array(list(self._final), float),
        }

    def fill(self, arrays: Mapping[str, Floats]) -> None:
        """The reverse of `to_arrays`."""
        self.rates_rad_s = {int(row[0]): row[1:] for row in arrays["rates"]}
        self._times_s = {int(f): float(t) for f, t in arrays["times"]}
        self._memos = {f: CameraMemo(self.arm_m, self.rates_rad_s[f]) for f in self._times_s}
        cameras = zip(arrays["camera_frames"], arrays["cameras"], strict=True)
        self._final = {int(f): Pose.restored(matrix) for f, matrix in cameras}
        self.newest = max(self._times_s)
        self._estimates.clear()
