"""Localization in a map of meshes: predict by IMU, associate, correct, gate, smooth (paper, Sec. IV-D)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from meshslam.geometry import Camera, Floats, Pose, View
from meshslam.graph import (
    ObservationCost,
    Smoother,
    StateMarginal,
    begin_with,
    marginal_of,
    place_camera,
    start_covariance,
)
from meshslam.initialization import EstimationConfig
from meshslam.localization.config import LocalizationConfig
from meshslam.localization.correction import Correction, MapObservation, correct
from meshslam.localization.data_association import FrameMasks, associate, in_view, observations_of
from meshslam.localization.map_models import KnownMap, KnownObject
from meshslam.motion import Interval, Mounting, NavState, Preintegrator, predict, rate_at
from meshslam.objects import ObjectConfig
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples

TOO_SMALL, NO_OBJECT_THERE = "too small", "no object of the map there"  # why a detection is not used
NOTHING_TO_MEASURE, DISAGREES = "nothing to measure", "disagrees with the path"
_PROCESS_SIGMAS = np.array([0.01] * 3 + [1e-3] * 3)  # what one prediction adds to a frame's pose


@dataclass(frozen=True, eq=False)
class FrameReport:
    """What one frame brought."""

    frame: int
    predicted: Pose  # world_from_camera by the IMU from the frame before
    corrected: Pose  # after this frame's update
    object_of_detection: dict[int, int]
    refused: tuple[int, ...]  # objects whose observations did not agree
    has_gap: bool
    reasons: dict[int, str] = field(default_factory=dict)  # why detections were not used, by detection


@dataclass(frozen=True, eq=False)
class PathEstimate:
    """What is known of each frame beside its pose."""

    covariances: Floats  # (n, 6, 6) of world_from_camera
    velocity_in_world: Floats  # (n, 3), of the camera
    biases: Floats  # (n, 6), of accelerometer and gyroscope
    observed: tuple[bool, ...]  # whether its own image says where the camera is


@dataclass(frozen=True, eq=False)
class _Prediction:
    """A frame before its detections are looked at."""

    frame: int
    state: NavState
    angular_rate_rad_s: Floats  # (3,), as measured
    added: Floats | None  # (6, 6), what the step from the last frame adds to the covariance of world_from_imu
    has_gap: bool = False


@dataclass
class LocalizationEstimator:
    """The camera in a known map; feed it frames in the order of their times."""

    camera: Camera
    known: KnownMap
    mounting: Mounting
    keypoint_names: Mapping[str, tuple[str, ...]]
    estimation: EstimationConfig
    config: LocalizationConfig
    keep_path: bool = True  # of all frames; else of those that the lag holds
    path: dict[int, Pose] = field(default_factory=dict)  # world_from_camera by frame, as last estimated
    covariances: dict[int, Floats] = field(default_factory=dict)  # (6, 6) of it, of the newest and those that left
    motions: dict[int, Floats] = field(default_factory=dict)  # (9,), the camera's velocity and the biases, likewise
    observed: set[int] = field(default_factory=set)  # frames that showed objects of the map
    moved: dict[int, int] = field(default_factory=dict)  # object to the frame at which it was found moved

    def __post_init__(self) -> None:
        given = self.estimation
        self._preintegrator = Preintegrator(given.imu)
        self._smoother = Smoother(given.imu, given.start, given.smoother, self.mounting)
        self._noise = self.config.noise.model()
        self._observation_config = ObjectConfig(edge_margin_px=self.config.edge_margin_px, crop_margin=0.2)
        self._state: NavState | None = None
        self._covariance = np.zeros((6, 6))
        self._refusals: dict[int, int] = {}

    def begin(self, frame: int, state: NavState, imu: ImuSamples, detections: tuple[Detection, ...]) -> FrameReport:
        """The first frame, whose state is known."""
        rate = rate_at(imu, state.time_s)
        self._smoother.begin(state, rate)
        self._frame_ids = [frame]
        return self._update(_Prediction(frame, state, rate, None), detections)

    def process(self, frame: int, time_s: float, imu: ImuSamples, detections: tuple[Detection, ...]) -> FrameReport:
        """The next frame, `imu` holding the samples since the last one."""
        assert self._state is not None
        last = self._state
        # Prediction by the preintegrated IMU
        interval = self._preintegrator.between(imu, last.time_s, time_s, last)
        state = predict(last, interval, time_s)
        self._smoother.advance(state, interval)
        self._frame_ids.append(frame)
        predicted = _Prediction(frame, state, interval.angular_rate_rad_s, _added(interval), interval.has_gap)
        return self._update(predicted, detections)

    def first_state(self) -> NavState:
        """The current estimate of the first frame's state, while the lag still holds it."""
        return self._smoother.estimate(0).state

    @property
    def current_mounting(self) -> Mounting:
        """The current estimate of how the camera is mounted."""
        return self._smoother.cameras.mounting()

    @property
    def velocity_and_covariance(self) -> tuple[Floats, Floats]:
        """The newest velocity (3,) of the IMU, and the covariance (6, 6) of its pose."""
        assert self._state is not None
        return self._state.velocity_in_world, self._covariance

    @property
    def camera_covariance(self) -> Floats:
        """Covariance (6, 6) of the newest world_from_camera, right perturbation, (translation, rotation)."""
        return self.covariances[self._frame_ids[-1]]

    def estimate(self) -> PathEstimate:
        """The state of every frame so far, as last estimated in the lag; only where the path is kept."""
        self._take_covariances(self._smoother.frames)
        frames = list(self.path)
        return PathEstimate(
            np.array([self.covariances[f] for f in frames]),
            np.array([self.motions[f][:3] for f in frames]),
            np.array([self.motions[f][3:] for f in frames]),
            tuple(f in self.observed for f in frames),
        )

    def paths_by_iteration(self) -> tuple[tuple[Pose, ...], ...]:
        """No paths: the smoother has no iterations that could be compared."""
        return ()

    def marginal(self) -> StateMarginal:
        """The marginal of the newest state; the window ends with this."""
        return marginal_of(self._smoother)

    def resume(self, marginal: StateMarginal) -> None:
        """Go on from a marginal."""
        begin_with(self._smoother, marginal)
        self._frame_ids = [-1]
        self._state = marginal.state
        self.path[-1] = self._smoother.estimate(0).world_from_camera
        self._take_covariances([0])

    def _update(self, predicted: _Prediction, detections: tuple[Detection, ...]) -> FrameReport:
        # The camera where the prediction puts it
        world_from_camera, camera_covariance = self._predicted_camera(predicted)
        # Data association and observations
        usable = tuple(d for d in detections if max(d.bbox[2:]) >= self.config.min_box_px)
        matched, observations = self._associated(FrameMasks(self.camera, usable), world_from_camera)
        # Correction and gate (paper, Sec. IV-D)
        kept, refused, corrected = self._agreeing(world_from_camera, camera_covariance, observations)
        self._smoother.cameras.place(corrected)
        self._count([matched[k].id for k in refused], [matched[k].id for k in kept], predicted.frame)
        # Smoothing over the lag
        for k in kept:
            seen = observations[k]
            self._smoother.objects.observe_known(seen.cost, matched[k].id, seen.world_from_object, seen.covariance)
        self._smoother.solve()
        # Estimates; what is older than the lag becomes a prior
        self._take_estimates()
        self._smoother.retire()
        if kept and self.keep_path:
            self.observed.add(predicted.frame)
        ids = {k: matched[k].id for k in kept}
        gone = tuple(sorted(matched[k].id for k in refused))
        frame = predicted.frame
        reasons = self._reasons(detections, matched, observations, refused)
        return FrameReport(frame, world_from_camera, self.path[frame], ids, gone, predicted.has_gap, reasons)

    def _reasons(
        self,
        detections: tuple[Detection, ...],
        matched: Mapping[int, KnownObject],
        observations: Mapping[int, MapObservation],
        refused: list[int],
    ) -> dict[int, str]:
        """Why detections were not used, by detection."""
        small = {d.id: TOO_SMALL for d in detections if max(d.bbox[2:]) < self.config.min_box_px}
        unmatched = {d.id: NO_OBJECT_THERE for d in detections if d.id not in matched}
        unclear = {k: NOTHING_TO_MEASURE for k in matched if k not in observations}
        return unmatched | small | unclear | dict.fromkeys(refused, DISAGREES)

    def _predicted_camera(self, predicted: _Prediction) -> tuple[Pose, Floats]:
        """world_from_camera and its covariance (6, 6) by the prediction."""
        mounting = self._smoother.cameras.mounting() if self._state is not None else self.mounting
        place = place_camera(
            predicted.state.world_from_imu,
            predicted.state.velocity_in_world,
            mounting.imu_from_camera,
            mounting.time_offset_s,
            predicted.angular_rate_rad_s - predicted.state.gyroscope_bias,
        )
        if predicted.added is None:
            return place.pose, start_covariance(self.estimation.start, place.pose)
        # the camera's own covariance moves along: the IMU's holds what the mounting is uncertain by
        last = self.path[self._frame_ids[-2]]
        along = (place.pose.inverse() @ last).adjoint()
        moved = along @ self.covariances[self._frame_ids[-2]] @ along.T
        return place.pose, moved + place.by_imu @ predicted.added @ place.by_imu.T

    def _associated(
        self, masks: FrameMasks, world_from_camera: Pose
    ) -> tuple[dict[int, KnownObject], dict[int, MapObservation]]:
        """The object that each detection shows, and its observation."""
        usable = [o for o in self.known.around(world_from_camera.translation) if o.id not in self.moved]
        expected = in_view(self.camera, world_from_camera, usable, self.config.association.max_distance_m)
        matched = associate(masks, world_from_camera, expected, self.config.association)
        views = observations_of(
            masks, world_from_camera, matched, expected, self.keypoint_names, self._observation_config
        )
        return matched, {k: self._map_observation(matched[k], view) for k, view in views.items()}

    def _map_observation(self, thing: KnownObject, view: View) -> MapObservation:
        cost = ObservationCost(thing.model, view, self._noise, self.camera.fx)
        covariance = thing.pose_covariance if self.config.use_map_covariance else None
        return MapObservation(cost, thing.world_from_object, covariance)

    def _agreeing(
        self, pose: Pose, covariance: Floats, observations: Mapping[int, MapObservation]
    ) -> tuple[list[int], list[int], Pose]:
        """Detections whose observations agree, the worst left out until all do; those left out; the pose then."""
        kept, refused, corrected = dict(observations), [], pose
        while kept:
            found: Correction = correct(pose, covariance, kept)
            corrected = found.world_from_camera
            worst = max(found.cost_shares, key=lambda k: found.cost_shares[k])
            if found.cost_shares[worst] <= self.config.gate.max_cost:
                break
            refused.append(worst)
            del kept[worst]
        return list(kept), refused, corrected if kept else pose

    def _count(self, refused: list[int], agreed: list[int], frame: int) -> None:
        """An object refused again and again was moved: its observations in the window are taken back."""
        for number in agreed:
            self._refusals[number] = 0
        for number in refused:
            self._refusals[number] = self._refusals.get(number, 0) + 1
            if self._refusals[number] >= self.config.gate.moved_views:
                self.moved[number] = frame
                self._smoother.forget(number)

    def _take_estimates(self) -> None:
        """Take over the smoother's estimates of the frames that it holds."""
        if not self.keep_path:
            self.path.clear()
            self.motions.clear()
        for index in self._smoother.frames:
            found, frame = self._smoother.estimate(index), self._frame_ids[index]
            self.path[frame] = found.world_from_camera
            self.motions[frame] = found.motion
        self._state = self._smoother.estimate(self._smoother.frame).state
        self._take_covariances([*(self._smoother.leaving if self.keep_path else []), self._smoother.frame])

    def _take_covariances(self, indices: Sequence[int]) -> None:
        """Take over covariances of frames that the smoother holds, the newest one's too."""
        found = self._smoother.cameras.covariances(indices)
        self._covariance = found[self._smoother.frame].world_from_imu
        if not self.keep_path:
            self.covariances.clear()
        for index in indices:
            self.covariances[self._frame_ids[index]] = found[index].world_from_camera


def _added(interval: Interval) -> Floats:
    """What a step adds to the covariance (6, 6) of world_from_imu: the uncertainty of velocity and IMU."""
    added = interval.measurements.preintMeasCov()[:6, :6]
    grown = np.diag(np.square(_PROCESS_SIGMAS))
    grown[:3, :3] += added[3:6, 3:6]
    grown[3:, 3:] += added[:3, :3]
    return grown
