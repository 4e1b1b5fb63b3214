"""The graph over a lag: IMU, mounting, objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, O, S, V, X, Z

from meshslam.geometry import Camera, Pose
from meshslam.geometry.arrays import Floats
from meshslam.localization.belief import SmootherBelief
from meshslam.localization.config import ImuConfig, SmootherConfig, StartConfig
from meshslam.localization.factors import CameraKeys, CameraMemo, SeenObject, object_factor, place_camera
from meshslam.localization.gtsam_bridge import OURS_FROM_GTSAM, from_pose3, to_gtsam_covariance, to_pose3
from meshslam.localization.imu import Interval, Mounting, NavState, RelativeMotion
from meshslam.localization.past import Pair, Past, smooth_whole
from meshslam.localization.point_factor import point_factor
from meshslam.localization.point_tracks import PointBlock, PointConfig
from meshslam.localization.road_factor import road_factor
from meshslam.localization.start_factors import OFFSET, ROTATION, start_factors
from meshslam.localization.tags import PointTag, RoadTag, ViewTag
from meshslam.localization.way_factor import way_factor
from meshslam.localization.window import Entry, Window, linear_factor

SIZE = S(0)
WAY = "way"  # tag of factors of the camera's way


@dataclass(frozen=True, eq=False)
class FrameEstimate:
    """What the smoother holds of a frame."""

    state: NavState
    world_from_camera: Pose


@dataclass(frozen=True, eq=False)
class WholePath:
    """All frames of a run, smoothed together."""

    world_from_camera: tuple[Pose, ...]
    world_from_object: dict[int, Pose]  # of those that were mapped along
    same: tuple[Pair, ...]  # objects that are one


class Smoother:
    """States of the last seconds; frames are numbered from 0 in the order in which they come."""

    def __init__(
        self,
        imu: ImuConfig,
        start: StartConfig,
        lag: SmootherConfig,
        mounting: Mounting,
        *,
        keep_past: bool = False,
    ) -> None:
        self._imu, self._start, self._lag, self._mounting = imu, start, lag, mounting
        self.window = Window()
        self.past = Past() if keep_past else None
        self.rates_rad_s: dict[int, Floats] = {}  # angular rate at each frame, free of bias
        self._times: dict[int, float] = {}
        self._memos: dict[int, CameraMemo] = {}
        self._objects: dict[int, int] = {}  # those estimated along, and the frame that saw each last
        self._shaped: dict[int, list[ViewTag]] = {}  # those whose modes are estimated too, and their views
        self._cameras: dict[int, Pose] = {}  # world_from_camera of each frame as it was when it left
        self.frame = -1

    def begin(self, state: NavState, rate_rad_s: Floats) -> None:
        """The first frame: its state and the mounting, each with its prior."""
        self.frame = 0
        self._insert(0, state, rate_rad_s)
        values, mounting = self.window.values, self._mounting
        values.insert(ROTATION, gtsam.Rot3(mounting.imu_from_camera.rotation))
        values.insert(OFFSET, np.array([mounting.time_offset_s]))
        for factor in start_factors(self._start, self._imu, state, mounting):
            self.window.add(factor)

    def advance(self, predicted: NavState, tie: Interval | RelativeMotion) -> None:
        """The next frame, tied to the last by its IMU samples, or by the camera's step."""
        i, j = self.frame, self.frame + 1
        self.frame = j
        self._insert(j, predicted, tie.angular_rate_rad_s)
        if isinstance(tie, Interval):
            self.window.add(gtsam.CombinedImuFactor(X(i), V(i), X(j), V(j), B(i), B(j), tie.measurements))
            return
        diagonal, isotropic = gtsam.noiseModel.Diagonal.Sigmas, gtsam.noiseModel.Isotropic.Sigma
        step = to_pose3(tie.first_from_second)
        self.window.add(gtsam.BetweenFactorPose3(X(i), X(j), step, diagonal(tie.sigmas[OURS_FROM_GTSAM])))
        # velocity and biases mean nothing here; the keys of views ask for them
        self.window.add(gtsam.PriorFactorVector(V(j), predicted.velocity_in_world, isotropic(3, 1.0)))
        self.window.add(gtsam.PriorFactorConstantBias(B(j), gtsam.imuBias.ConstantBias(), isotropic(6, 1e-3)))

    def see(self, seen: SeenObject, number: int, world_from_object: Pose, covariance: Floats | None) -> None:
        """A view of an object in this frame; with a covariance (6, 6) its pose is estimated along."""
        key: Pose | int = world_from_object
        if covariance is not None:
            key = O(number)
            if number not in self._objects:
                self.window.values.insert(key, to_pose3(world_from_object))
                prior = gtsam.noiseModel.Gaussian.Covariance(to_gtsam_covariance(covariance))
                self.window.add(gtsam.PriorFactorPose3(key, to_pose3(world_from_object), prior))
            self._objects[number] = self.frame
        factor = object_factor(seen, self.camera_keys(self.frame), self._memos[self.frame], key)
        self.window.add(factor, ViewTag(number, self.frame, seen))

    def add_object(self, number: int, world_from_object: Pose, z: Floats, growth: Floats, size_sigma: float) -> None:
        """An object that is mapped along: its pose is free, its modes z ~ N(s g, I).

        g (modes,), of unit length, makes an object larger as a whole; s ~ N(0, size_sigma^2) is one for all objects:
        the cars of a place may all be larger than the category's mean, which else would be a measure of length.
        """
        values, noise = self.window.values, gtsam.noiseModel
        values.insert(O(number), to_pose3(world_from_object))
        values.insert(Z(number), z)
        loose = noise.Diagonal.Sigmas(np.array([1.0] * 3 + [10.0] * 3))
        self.window.add(gtsam.PriorFactorPose3(O(number), to_pose3(world_from_object), loose))
        if not values.exists(SIZE):
            values.insert(SIZE, np.zeros(1))
            self.window.add(gtsam.PriorFactorVector(SIZE, np.zeros(1), noise.Isotropic.Sigma(1, size_sigma)))
        self.window.add(linear_factor(Z(number), np.eye(len(z)), SIZE, -growth[:, None]))
        self._objects[number] = self.frame
        self._shaped[number] = []

    def see_shaped(self, seen: SeenObject, number: int, frame: int) -> Entry:
        """A view, in a frame that is held, of an object that is mapped along."""
        keys, memo = self.camera_keys(frame), self._memos[frame]
        self._objects[number] = max(frame, self._objects[number])
        tag = ViewTag(number, frame, seen)
        self._shaped[number].append(tag)
        return self.window.add(object_factor(seen, keys, memo, O(number), Z(number)), tag)

    def stand_on_road(self, number: int, frame: int, below_camera_m: float, sigma_m: float) -> None:
        """An object's origin lies so far below the camera of a frame: its wheels stand on the road.

        What the window said of its height before is replaced.
        """
        self.window.drop([e for e in self.window.entries if e.tag == RoadTag(number)])
        factor = road_factor(X(frame), O(number), self.arm_m, below_camera_m, sigma_m)
        self.window.settle([self.window.add(factor, RoadTag(number))])

    def follow_points(self, block: PointBlock, camera: Camera, config: PointConfig) -> None:
        """Corners of a block of frames; what was said of the open block before is replaced."""
        tag = PointTag(block.row, block.first)
        points = [e for e in self.window.entries if isinstance(e.tag, PointTag) and e.tag.row == block.row]
        self.window.drop([e for e in points if e.tag == tag])
        self.window.settle([e for e in points if e.tag != tag])
        if block.tracks and block.first in self._times:
            frames = range(block.first, block.last + 1)
            keys, memos = {f: self.camera_keys(f) for f in frames}, {f: self._memos[f] for f in frames}
            self.window.add(point_factor(block, keys, memos, camera, config), tag)

    def come(self, first: int, second: int, way_m: float, sigma_m: float) -> None:
        """The camera came so far from one frame to another, both of which are held."""
        self.window.settle([e for e in self.window.entries if e.tag == WAY])
        self.window.add(way_factor([X(first), X(second)], self.arm_m, way_m, sigma_m), WAY)

    def object_state(self, number: int) -> tuple[Pose, Floats]:
        """Pose and modes of an object that is mapped along."""
        values = self.window.values
        return from_pose3(values.atPose3(O(number))), values.atVector(Z(number))

    @property
    def shaped_objects(self) -> list[int]:
        """Objects in the window that are mapped along."""
        return sorted(self._shaped)

    def holds_object(self, number: int) -> bool:
        """Whether an object is in the window."""
        return number in self._objects

    def update(self) -> None:
        """Solve; views that are old enough are held as linear factors."""
        self.window.optimize(self._lag.iterations)
        self.window.settle([e for e, tag in self._views() if tag.frame <= self.frame - self._lag.settled_frames])

    def close(self) -> None:
        """Let states older than the lag, and objects that only they saw, become a prior."""
        oldest = self._times[self.frame] - self._lag.lag_s
        gone = [f for f, t in self._times.items() if t < oldest]
        keys = {key for f in gone for key in (X(f), V(f), B(f))}
        for frame in gone:
            self._cameras[frame] = self.estimate(frame).world_from_camera
            del self._times[frame], self._memos[frame]
        unseen = [n for n, last in self._objects.items() if last not in self._times]
        for number in unseen:
            del self._objects[number]
            self._freeze(number)
        shaped = {Z(n) for n in unseen if n in self._shaped}
        keys |= {O(n) for n in unseen} | shaped
        if self.past is None:
            self.window.marginalize(keys)
        else:
            self.past.take(self.window, keys)
        for number in unseen:
            self._shaped.pop(number, None)

    def _freeze(self, number: int) -> None:
        """Linearize an object's views for good where it is now that all have spoken."""
        views = self._shaped.get(number, [])
        for tag in views:
            pose, z = self.object_state(number)
            tag.seen.freeze(self._camera(tag.frame).inverse() @ pose, z)

    def freeze_all(self) -> None:
        """Linearize all views for good where they now are."""
        for number in list(self._shaped):
            self._freeze(number)
            self._shaped[number] = []

    def bookkeeping(self) -> dict[str, Floats]:
        """All but the graph, as plain arrays."""
        return {
            "rates": np.array([[f, *rate] for f, rate in self.rates_rad_s.items()]),
            "times": np.array([[f, t] for f, t in self._times.items()]),
            "cameras": np.array([pose.matrix for pose in self._cameras.values()]).reshape(-1, 4, 4),
            "camera_frames": np.array(list(self._cameras), float),
            "objects": np.array([[n, f, n in self._shaped] for n, f in self._objects.items()], float).reshape(-1, 3),
        }

    def keep_books(self, arrays: Mapping[str, Floats]) -> None:
        """The reverse of `bookkeeping`."""
        self.rates_rad_s = {int(row[0]): row[1:] for row in arrays["rates"]}
        self._times = {int(f): float(t) for f, t in arrays["times"]}
        self._memos = {f: CameraMemo(self.arm_m, self.rates_rad_s[f]) for f in self._times}
        cameras = zip(arrays["camera_frames"], arrays["cameras"], strict=True)
        self._cameras = {int(f): Pose.from_matrix(matrix) for f, matrix in cameras}
        self._objects = {int(n): int(f) for n, f, _ in arrays["objects"]}
        self._shaped = {int(n): [] for n, _, shaped in arrays["objects"] if shaped}
        self.frame = max(self._times)

    def belief(self) -> SmootherBelief:
        """Take all but the newest state and the mounting out; what the others said stays."""
        newest = self.frame
        keep = [ROTATION, OFFSET, V(newest), X(newest), B(newest)]
        held = set(self.window.values.keys())
        self.window.marginalize(held - set(keep))
        ordering = gtsam.Ordering()
        for key in keep:
            ordering.push_back(key)
        rows = np.asarray(self.window.linearized().augmentedJacobian(ordering))
        estimate = self.estimate(newest)
        for frame in [f for f in self._times if f != newest]:
            del self._times[frame], self._memos[frame]
        self._objects, self._shaped = {}, {}
        return SmootherBelief(estimate.state, self.rates_rad_s[newest], self.mounting(), rows)

    def resume(self, belief: SmootherBelief) -> None:
        """Begin with a belief as the only prior."""
        self.frame, self._mounting = 0, belief.mounting
        values = self.window.values
        values.insert(ROTATION, gtsam.Rot3.ClosestTo(belief.mounting.imu_from_camera.rotation))
        values.insert(OFFSET, np.array([belief.mounting.time_offset_s]))
        self._insert(0, belief.state, belief.rate_rad_s + belief.state.gyroscope_bias)
        self.window.add_rows([(ROTATION, 3), (OFFSET, 1), (V(0), 3), (X(0), 6), (B(0), 6)], belief.rows)

    def forget(self, number: int) -> None:
        """Take back all that views say of an object, but for what has become a prior of others."""
        self.window.drop([e for e, tag in self._views() if tag.number == number])
        if number in self._shaped:
            self.window.drop([e for e in self.window.entries if e.tag == RoadTag(number)])
            self._shaped[number] = []
        if self.past is not None:
            self.past.forget(number)

    def drop_views(self, entries: Sequence[Entry]) -> None:
        """Take views of this frame back."""
        self.window.drop(entries)
        gone = {id(entry.tag) for entry in entries}
        self._shaped = {n: [tag for tag in tags if id(tag) not in gone] for n, tags in self._shaped.items()}

    def views_of(self, number: int) -> list[tuple[int, Floats, Floats]]:
        """Frame, Jacobian (n, 6 + modes) and residual (n,) of each view of an object that is mapped along."""
        pose, z = self.object_state(number)
        tags = self._shaped[number]
        return [(tag.frame, *tag.seen.linearize(self._camera(tag.frame).inverse() @ pose, z)) for tag in tags]

    def _camera(self, frame: int) -> Pose:
        return self._cameras[frame] if frame in self._cameras else self.estimate(frame).world_from_camera

    def _views(self) -> list[tuple[Entry, ViewTag]]:
        return [(e, e.tag) for e in self.window.entries if isinstance(e.tag, ViewTag)]

    @property
    def frames(self) -> list[int]:
        """The frames that are held."""
        return sorted(self._times)

    def estimate(self, frame: int) -> FrameEstimate:
        """A frame as it is now seen."""
        values = self.window.values
        bias = values.atConstantBias(B(frame))
        pose, velocity = from_pose3(values.atPose3(X(frame))), values.atVector(V(frame))
        state = NavState(self._times[frame], pose, velocity, bias.accelerometer(), bias.gyroscope())
        return FrameEstimate(state, self.mounting().world_from_camera(state, self.rates_rad_s[frame]))

    def whole_path(self, same: Sequence[Pair], iterations: int) -> WholePath:
        """Smooth over all frames and objects there were, `same` being pairs of objects that are one."""
        assert self.past is not None
        values, held = smooth_whole(self.past, self.window, same, iterations)
        turn, offset = Pose(values.atRot3(ROTATION).matrix(), self.arm_m), float(values.atVector(OFFSET)[0])
        cameras = [
            place_camera(from_pose3(values.atPose3(X(f))), values.atVector(V(f)), turn, offset, rate).pose
            for f, rate in sorted(self.rates_rad_s.items())
        ]
        modes = [gtsam.Symbol(key).index() for key in values.keys() if chr(gtsam.Symbol(key).chr()) == "z"]  # noqa: SIM118
        objects = {number: from_pose3(values.atPose3(O(number))) for number in sorted(modes)}
        return WholePath(tuple(cameras), objects, held)

    def mounting(self) -> Mounting:
        """How the camera is mounted, as it is now seen."""
        values = self.window.values
        return Mounting(Pose(values.atRot3(ROTATION).matrix(), self.arm_m), float(values.atVector(OFFSET)[0]))

    def pose_covariance(self, frame: int) -> Floats:
        """Covariance (6, 6) of world_from_imu, right perturbation, (translation, rotation)."""
        return to_gtsam_covariance(self.window.covariance(X(frame)))

    def camera_keys(self, frame: int) -> CameraKeys:
        """The variables that place a frame's camera."""
        return X(frame), V(frame), ROTATION, OFFSET

    @property
    def arm_m(self) -> Floats:
        """The camera (3,) in the IMU's frame."""
        return self._mounting.imu_from_camera.translation

    def _insert(self, frame: int, state: NavState, rate_rad_s: Floats) -> None:
        values = self.window.values
        values.insert(X(frame), to_pose3(state.world_from_imu))
        values.insert(V(frame), state.velocity_in_world)
        values.insert(B(frame), gtsam.imuBias.ConstantBias(state.accelerometer_bias, state.gyroscope_bias))
        self._times[frame], self.rates_rad_s[frame] = state.time_s, rate_rad_s - state.gyroscope_bias
        self._memos[frame] = CameraMemo(self.arm_m, self.rates_rad_s[frame])

    def start_at(self, world_from_camera: Pose) -> None:
        """Begin the search of the newest frame's pose where its camera is believed to be."""
        moved = world_from_camera @ self.estimate(self.frame).world_from_camera.inverse()
        key = X(self.frame)
        self.window.values.update(key, to_pose3(moved @ from_pose3(self.window.values.atPose3(key))))
