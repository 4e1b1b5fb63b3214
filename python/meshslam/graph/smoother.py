"""The fixed-lag smoother: the states of the last seconds, and the objects that they observe."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, O, V, X

from meshslam.geometry import Floats, Pose
from meshslam.graph.camera_covariance import path_covariances
from meshslam.graph.camera_states import CameraStates, FrameEstimate
from meshslam.graph.config import SmootherConfig, StartConfig
from meshslam.graph.full_trajectory import FindPairs, History, Pair, smooth_full_trajectory
from meshslam.graph.measurements import Measurements
from meshslam.graph.object_covariance import ObjectCovariance, object_covariances
from meshslam.graph.object_factor import CameraPlace, place_camera
from meshslam.graph.object_variables import ObjectVariables
from meshslam.graph.record_factors import add_record
from meshslam.graph.records import biases_record, imu_record, step_record, vector_record
from meshslam.graph.start_factors import OFFSET, ROTATION, start_records
from meshslam.graph.tags import DISPLACEMENT, ObservationTag, PointTag
from meshslam.graph.window import Entry, Window
from meshslam.motion import ImuConfig, Interval, Mounting, NavState, RelativeMotion, from_pose3


@dataclass(frozen=True, eq=False)
class FullTrajectory:
    """All frames of a run, smoothed together."""

    world_from_camera: tuple[Pose, ...]
    world_from_object: dict[int, Pose]  # of landmarks
    modes: dict[int, Floats]  # likewise, (modes,)
    joined: tuple[Pair, ...]  # landmarks that are one object
    velocity_in_world: Floats  # (n, 3), of the cameras
    biases: Floats  # (n, 6), of accelerometer and gyroscope
    observed: tuple[bool, ...]  # whether its own image says where a frame's camera is
    window: Window  # all variables and factors
    places: tuple[CameraPlace, ...]  # of the cameras

    def covariances(self, world_from_first_camera: Callable[[Pose], Pose] | None = None) -> Floats:
        """Covariances (n, 6, 6) of the cameras' poses, see `path_covariances`."""
        keys = [(X(f), V(f), ROTATION, OFFSET) for f in range(len(self.places))]
        return path_covariances(self.window, self.places, keys, world_from_first_camera)

    def object_covariances(
        self, numbers: Sequence[int], world_from_first_camera: Callable[[Pose], Pose] | None = None
    ) -> dict[int, ObjectCovariance]:
        """Covariances of landmarks, with the path's uncertainty, see `object_covariances`."""
        first = self.places[0], (X(0), V(0), ROTATION, OFFSET)
        return object_covariances(self.window, numbers, first, world_from_first_camera)


class Smoother:
    """Predict with `advance`, add factors through `objects` and `measurements`, `solve`, then `retire` what is old."""

    def __init__(
        self,
        imu: ImuConfig,
        start: StartConfig,
        lag: SmootherConfig,
        mounting: Mounting,
        *,
        keep_history: bool = False,
    ) -> None:
        self._imu, self._start, self._lag, self._mounting = imu, start, lag, mounting
        self.window = Window()
        self.history = History() if keep_history else None
        self.cameras = CameraStates(self.window, mounting)
        self.objects = ObjectVariables(self.window, self.cameras)
        self.measurements = Measurements(self.window, self.cameras)

    @property
    def frame(self) -> int:
        """The newest frame."""
        return self.cameras.newest

    @property
    def frames(self) -> list[int]:
        """The frames that are held."""
        return self.cameras.held

    def estimate(self, frame: int) -> FrameEstimate:
        """The current estimate of a frame that is held."""
        return self.cameras.estimate(frame)

    def begin(self, state: NavState, rate_rad_s: Floats) -> None:
        """The first frame: its state and the mounting, each with its prior."""
        self.cameras.insert(0, state, rate_rad_s)
        values, mounting = self.window.values, self._mounting
        values.insert(ROTATION, gtsam.Rot3(mounting.imu_from_camera.rotation))
        values.insert(OFFSET, np.array([mounting.time_offset_s]))
        for record in start_records(self._start, self._imu, state, mounting, self.cameras.keys(0)):
            add_record(self.window, record, self.cameras)

    def advance(self, predicted: NavState, tie: Interval | RelativeMotion) -> None:
        """The next frame, tied to the last by its IMU samples, or by the camera's relative motion."""
        i, j = self.frame, self.frame + 1
        self.cameras.insert(j, predicted, tie.angular_rate_rad_s)
        records = (
            [imu_record((X(i), V(i), X(j), V(j), B(i), B(j)), tie.readings)]
            if isinstance(tie, Interval)
            else [
                step_record(X(i), X(j), tie),
                # velocity and biases mean nothing here; the keys of observations ask for them
                vector_record(V(j), predicted.velocity_in_world, 1.0),
                biases_record(B(j), np.zeros(6), np.full(6, 1e-3)),
            ]
        )
        for record in records:
            add_record(self.window, record, self.cameras)

    def solve(self) -> None:
        """Lower the cost of the window; observations that are old enough are held as linear factors."""
        marginals = [key for frame in {*self.leaving, self.frame} for key in self.cameras.keys(frame)]
        self.window.optimize(self._lag.iterations, last=sorted(set(marginals)))
        oldest = self.frame - self._lag.settled_frames
        self.window.settle([e for e, tag in self.objects.observations() if tag.frame <= oldest])

    def leaves_next(self, number: int) -> bool:
        """Whether `retire` will take an object out of the window."""
        return self.objects.last_frame(number) in self._too_old()

    def _too_old(self) -> list[int]:
        return self.cameras.older_than(self.cameras.time_s(self.frame) - self._lag.lag_s)

    @property
    def leaving(self) -> list[int]:
        """The frames that `retire` will take out."""
        return self._too_old()

    def retire(self) -> None:
        """States older than the lag, and objects that only they observed, become a linearized prior."""
        keys = self.cameras.retire(self._too_old(), keep=self.history is not None)
        keys |= self.objects.retire_unobserved()
        if self.history is None:
            self.window.marginalize(keys)
        else:
            self.history.take(self.window, keys)

    def forget(self, number: int) -> None:
        """Take back all observations of an object, but for what has become a prior of others."""
        self.objects.forget(number)
        if self.history is not None:
            self.history.forget(number)

    def full_trajectory(
        self, joined: Sequence[Pair], iterations: int, find_more: FindPairs | None = None
    ) -> FullTrajectory:
        """Smooth over all frames and landmarks there were, see `smooth_full_trajectory`.

        `joined` are pairs of landmarks that are one object, `find_more` finds others in the smoothed graph.
        """
        assert self.history is not None
        everything, held = smooth_full_trajectory(self.history, self.window, joined, iterations, find_more)
        values = everything.values
        turn = Pose(values.atRot3(ROTATION).matrix(), self.cameras.arm_m)
        offset = float(values.atVector(OFFSET)[0])
        rates = sorted(self.cameras.rates_rad_s.items())
        places = [
            place_camera(from_pose3(values.atPose3(X(f))), values.atVector(V(f)), turn, offset, rate)
            for f, rate in rates
        ]
        modes = {gtsam.Symbol(k).index(): values.atVector(k) for k in sorted(values.keys()) if _is_modes(k)}
        objects = {number: from_pose3(values.atPose3(O(number))) for number in modes}
        seen = {key for entry in everything.entries if _is_of_images(entry) for key in entry.keys}
        return FullTrajectory(
            tuple(place.pose for place in places),
            objects,
            modes,
            held,
            np.array([place.pose.rotation @ place.by_offset[:3, 0] for place in places]),
            np.array([values.atConstantBias(B(f)).vector() for f, _ in rates]),
            tuple(X(f) in seen for f, _ in rates),
            everything,
            tuple(places),
        )


def _is_of_images(entry: Entry) -> bool:
    return isinstance(entry.tag, ObservationTag | PointTag) or entry.tag == DISPLACEMENT


def _is_modes(key: int) -> bool:
    return chr(gtsam.Symbol(key).chr()) == "z"
