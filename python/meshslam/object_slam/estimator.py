"""Joint SLAM: camera and objects (pose, modes) in one graph, frame by frame, from detections with tracks and IMU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshslam.features import ImageFeatures
from meshslam.geometry import Floats, Pose
from meshslam.graph import CameraPrediction, Entry, FullTrajectory, ObservationCost, Pair, Smoother
from meshslam.motion import ImuMotion, MotionSource, NavState
from meshslam.object_slam.landmarks import (
    Landmark,
    OdometryFrame,
    coincident_landmarks,
    find_loop_closure,
    scale_direction,
)
from meshslam.object_slam.motion_test import LinearView, fit_velocity
from meshslam.object_slam.object_start import Candidate, NoObject, object_of
from meshslam.object_slam.observations import ObservationMaker, TrackObservation
from meshslam.object_slam.road_displacements import RoadDisplacements
from meshslam.object_slam.setup import SlamSetup
from meshslam.objects import Reconstruction, Scene, Track, road_points
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples


@dataclass(frozen=True, eq=False)
class SlamReport:
    """What one frame brought."""

    frame: int
    world_from_camera: Pose  # in the map
    covariance: Floats  # (6, 6) of it, but for the last loop closure's
    objects: tuple[int, ...]  # landmarks observed in the frame
    has_gap: bool


@dataclass(frozen=True, eq=False)
class _Added:
    """An observation of this frame that became a factor."""

    landmark: int
    entry: Entry
    cost: ObservationCost
    index: int  # of the frame


class SlamEstimator:
    """The camera among objects that are not known before; feed it frames in the order of their times."""

    def __init__(
        self, setup: SlamSetup, motion: MotionSource | None = None, image_features: ImageFeatures | None = None
    ) -> None:
        """Without a motion source the IMU is it; image features are looked up by the frames' indices."""
        self.setup, self.image_features = setup, image_features
        self.motion = motion or ImuMotion(setup.imu)
        lag = replace(setup.estimation.smoother, lag_s=setup.slam.lag_s)
        self.smoother = Smoother(setup.imu, setup.estimation.start, lag, setup.mounting, keep_history=True)
        crop = replace(setup.objects, crop_margin=setup.slam.crop_margin)
        self.observations = ObservationMaker(setup.camera, setup.category, setup.model, setup.keypoint_names, crop)
        self.road = _road(setup, image_features)
        self._scale_direction = scale_direction(setup.category)
        # the camera
        self.frame_ids: list[int] = []
        self.times_s: list[float] = []
        self.path: dict[int, Pose] = {}  # world_from_camera of every frame, as last estimated, in the odometry's world
        self.odometry_frame = OdometryFrame()
        # the objects
        self.candidates: dict[int, Candidate] = {}  # by track
        self.landmarks: dict[int, Landmark] = {}
        self.in_view: dict[int, int] = {}  # by track, its landmark in the window
        self.moving: set[int] = set()  # tracks
        self.joined: list[Pair] = []  # landmarks that are one object, (newer, older)
        self.looked_at = -1  # the newest frame whose detections were taken in
        self.prediction: CameraPrediction | None = None  # from the newest frame on; None before there is one

    def begin(self, frame: int, state: NavState, imu: ImuSamples, detections: Sequence[Detection]) -> SlamReport:
        """The first frame, whose state is known: it sets the world."""
        self.smoother.begin(state, self.motion.first_rate(imu, state.time_s))
        self.state = state
        return self._update(frame, state.time_s, detections, has_gap=False)

    def process(
        self,
        frame: int,
        time_s: float,
        imu: ImuSamples,
        detections: Sequence[Detection] | None,
        late: Mapping[int, Sequence[Detection]] | None = None,
    ) -> SlamReport:
        """The next frame, `imu` holding the samples since the last one.

        `detections` are None where nobody has looked at its image yet; `late` are those of earlier frames, by number.
        """
        # Prediction by IMU, odometry or images
        predicted, tie = self.motion.between(imu, self.state, time_s, self.smoother.frame + 1)
        self.smoother.advance(predicted, tie)
        # Point tracks
        if self.image_features is not None and self.setup.slam.points.enabled:
            for tracks in self.image_features.point_tracks(self.smoother.frame):
                self.smoother.measurements.add_point_tracks(tracks, self.setup.camera, self.setup.slam.points)
        return self._update(frame, time_s, detections, has_gap=tie.has_gap, late=late)

    def observe(self, late: Mapping[int, Sequence[Detection]]) -> None:
        """Detections of frames that are there already, by number, without a new frame."""
        added = self._associate(late, None)
        self.smoother.solve()
        self._gate(added)
        self._initialize_objects()
        self._take_estimates()
        for number in {factor.landmark for factor in added}:
            self._observed(number)

    def holds(self, frame: int) -> bool:
        """Whether the window holds a frame, by its number."""
        return any(self.frame_ids[index] == frame for index in self.smoother.frames)

    def _update(
        self,
        frame: int,
        time_s: float,
        detections: Sequence[Detection] | None,
        *,
        has_gap: bool,
        late: Mapping[int, Sequence[Detection]] | None = None,
    ) -> SlamReport:
        self._append(frame, time_s)
        # Data association by tracks: observations of landmarks become factors, the others wait
        added = self._associate(late or {}, detections)
        self.smoother.solve()
        # Gate: observations that do not fit where all factors agree
        self._gate(added)
        # Initialization of objects (Sec. IV-C)
        self._initialize_objects()
        # The road's texture as a measure of length
        if self.road is not None and self.image_features is not None:
            self.road.step(self.smoother, self.image_features)
        # Estimates, wheels on the road, motion test
        self._take_estimates()
        observed = sorted({factor.landmark for factor in added})
        for number in observed:
            self._observed(number)
        covariance = self.camera_covariance()
        self.prediction = self.smoother.cameras.prediction()
        # What is older than the lag becomes a linearized prior
        self._retire()
        # Loop closure
        self._close_loops()
        in_map = self.odometry_frame.map_from_odometry @ self.path[frame]
        return SlamReport(frame, in_map, covariance, tuple(observed), has_gap)

    def first_state(self) -> NavState:
        """The current estimate of the first frame's state, while the lag still holds it."""
        first = self.smoother.estimate(0).state
        if self.motion.knows_velocity or self.smoother.frame == 0:
            return first
        second = self.smoother.estimate(1).state
        step = second.world_from_imu.translation - first.world_from_imu.translation
        return replace(first, velocity_in_world=step / (second.time_s - first.time_s))

    def finish(self) -> FullTrajectory:
        """All frames so far, smoothed together with all observations; the run can go on.

        Landmarks that then stand in one place are one object, and once joined, hold the path together too.
        """

        def coincident(places: Mapping[int, Pose], joined: Sequence[Pair]) -> list[Pair]:
            standing = {n: pose for n, pose in places.items() if self.landmarks[n].counts}
            return coincident_landmarks(standing, joined, self.setup.mapping.merge_distance_m)

        return self.smoother.full_trajectory(self.joined, self.setup.slam.full_trajectory_iterations, coincident)

    def camera_covariance(self) -> Floats:
        """Covariance (6, 6) of the newest world_from_camera, right perturbation, (translation, rotation)."""
        newest = self.smoother.frame
        with self.smoother.objects.linearizations_kept():
            return self.smoother.cameras.covariances([newest])[newest].world_from_camera

    def landmark_covariance(self, number: int) -> Floats:
        """Covariance (6, 6) of a landmark's pose: the current one, or the last one before it left the window."""
        left = self.landmarks[number].pose_covariance
        if left is not None:
            return left
        with self.smoother.objects.linearizations_kept():
            return self.smoother.objects.pose_covariance(number)

    def landmark_covariances(self) -> dict[int, Floats]:
        """As `landmark_covariance` of every landmark that counts, at the cost of one."""
        held = {number: mark.pose_covariance for number, mark in self.landmarks.items() if mark.counts}
        with self.smoother.objects.linearizations_kept():
            current = self.smoother.objects.pose_covariances([n for n, left in held.items() if left is None])
        return {n: current[n] if left is None else left for n, left in held.items()}

    def _append(self, frame: int, time_s: float) -> None:
        self.frame_ids.append(frame)
        self.times_s.append(time_s)
        self.path[frame] = self.smoother.estimate(self.smoother.frame).world_from_camera

    def _associate(
        self, late: Mapping[int, Sequence[Detection]], detections: Sequence[Detection] | None
    ) -> list[_Added]:
        """Factors of the frames that were looked at; frames that have left the window are passed over."""
        index_of = {self.frame_ids[index]: index for index in self.smoother.frames}
        seen = {index_of[frame]: found for frame, found in late.items() if frame in index_of}
        if detections is not None:
            seen[self.smoother.frame] = detections
        self.looked_at = max([self.looked_at, *seen])
        return [factor for index in sorted(seen) for factor in self._associate_frame(index, seen[index])]

    def _associate_frame(self, index: int, detections: Sequence[Detection]) -> list[_Added]:
        """Factors of one frame's landmarks; what is no landmark waits to become one."""
        added: list[_Added] = []
        for observation in self.observations.of_frame(index, detections):
            track = observation.detection.track_id
            assert track is not None
            number = self.in_view.get(track)
            if number is not None:
                cost = self._cost(observation, self.smoother.objects.state(number)[0])
                entry = self.smoother.objects.observe_landmark(cost, number, observation.index)
                added.append(_Added(number, entry, cost, observation.index))
            elif track not in self.moving:
                self.candidates.setdefault(track, Candidate()).observations.append(observation)
        return added

    def _cost(self, observation: TrackObservation, world_from_object: Pose) -> ObservationCost:
        """The observation's cost, with the noise of the object's own shape and key points at its current depth.

        A noise that followed the depth would make all that is nearer and smaller cost less.
        """
        setup = self.setup
        world_from_camera = self.smoother.estimate(observation.index).world_from_camera
        depth_m = max(1.0, float(world_from_camera.inverse().transform(world_from_object.translation)[2]))
        metre_px = setup.camera.fx / depth_m
        view = observation.view.with_surface_sigma(setup.slam.surface_sigma_m * metre_px)
        view = view.with_keypoint_sigma(setup.objects.noise.keypoint_position_sigma_m * metre_px)
        return ObservationCost(setup.model, view, setup.noise, setup.camera.fx)

    def _gate(self, added: Sequence[_Added]) -> None:
        """Drop new observations that fit badly."""
        bad = []
        for factor in added:
            pose, z = self.smoother.objects.state(factor.landmark)
            camera = self.smoother.estimate(factor.index).world_from_camera
            if factor.cost.cost_share(camera.inverse() @ pose, z) > self.setup.slam.max_cost:
                bad.append(factor.entry)
        if bad:
            self.smoother.objects.drop(bad)
            self.smoother.solve()

    def _initialize_objects(self) -> None:
        """Turn candidates that were seen long enough into landmarks."""
        if any([self._start(track) for track in list(self.candidates) if self._is_ready(track)]):
            self.smoother.solve()

    def _is_ready(self, track: int) -> bool:
        candidate, config = self.candidates[track], self.setup.slam
        held = set(self.smoother.frames)
        candidate.observations = [o for o in candidate.observations if o.index in held]
        seen = candidate.observations
        if len(seen) < max(config.start_views, candidate.next_try):
            return False
        if seen[-1].index < self.looked_at or max(o.detection.bbox[2] for o in seen) < config.min_box_px:
            return False
        first, last = (self.path[self.frame_ids[o.index]].translation for o in (seen[0], seen[-1]))
        return float(np.linalg.norm(last - first)) >= config.min_baseline_m

    def _start(self, track: int) -> bool:
        """Estimate a track's object at the current camera poses; if it fits, it becomes a landmark."""
        candidate = self.candidates[track]
        found = self._reconstructed(candidate.observations)
        if found is NoObject.DOES_NOT_FIT:
            candidate.next_try = len(candidate.observations) + self.setup.slam.retry_views
            return False
        del self.candidates[track]
        if isinstance(found, NoObject):
            self.moving.add(track)
            return False
        pose, z = found.state.world_from_object, found.state.z
        number = len(self.landmarks) + 1
        size = np.ptp(self.setup.model.vertices(found.state), axis=0)
        self.landmarks[number] = Landmark(number, track, pose, z, size, len(candidate.observations))
        self.in_view[track] = number
        self.smoother.objects.add_landmark(number, pose, z, self._scale_direction, self.setup.slam.size_sigma)
        for observation in candidate.observations:
            self.smoother.objects.observe_landmark(self._cost(observation, pose), number, observation.index)
        return True

    def _reconstructed(self, observations: Sequence[TrackObservation]) -> Reconstruction | NoObject:
        setup = self.setup
        poses = tuple(self.smoother.estimate(o.index).world_from_camera for o in observations)
        times = np.array([self.times_s[o.index] for o in observations])
        track = Track(0, tuple(o.detection for o in observations), poses, times)
        road = None
        if setup.height_above_ground_m is not None:
            road = road_points([self.path[f] for f in self.frame_ids], setup.height_above_ground_m)
        scene = Scene(setup.camera, setup.category, setup.model, setup.keypoint_names, road, setup.objects)
        return object_of(track, [o.occluder for o in observations], scene, setup.slam.min_mask_iou)

    def _take_estimates(self) -> None:
        """Take over the smoother's estimates of frames and landmarks."""
        for index in self.smoother.frames:
            self.path[self.frame_ids[index]] = self.smoother.estimate(index).world_from_camera
        self.state = self.smoother.estimate(self.smoother.frame).state
        for number in self.smoother.objects.landmarks:
            landmark = self.landmarks[number]
            landmark.world_from_object, landmark.z = self.smoother.objects.state(number)

    def _observed(self, number: int) -> None:
        """Note that a landmark was observed; put it on the road, and now and then test whether it moves."""
        landmark = self.landmarks[number]
        landmark.views += 1
        landmark.drift_m = self.odometry_frame.drift_m
        landmark.dimensions = np.ptp(self.vertices(landmark), axis=0)
        if self._shape_error(landmark) > self.setup.slam.max_shape_error:
            self._withdraw(landmark)
            return
        self._put_on_road(landmark)
        if landmark.views % self.setup.slam.motion_views == 0:
            self._test_motion(landmark)

    def _shape_error(self, landmark: Landmark) -> float:
        """Squared distance of the modes from the category's mean, without the size that all objects share."""
        own = landmark.z - (landmark.z @ self._scale_direction) * self._scale_direction
        return float(own @ own)

    def _withdraw(self, landmark: Landmark) -> None:
        """Take a landmark back, such as one of a wrong heading; its track may become another one."""
        landmark.is_withdrawn = True
        self.in_view.pop(landmark.track, None)
        self.smoother.forget(landmark.number)

    def vertices(self, landmark: Landmark) -> Floats:
        """A landmark's mesh (V, 3) in its own frame."""
        model = self.setup.model
        return model.vertices(replace(model.state_at(landmark.world_from_object), z=landmark.z))

    def _put_on_road(self, landmark: Landmark) -> None:
        """Measure the height of an object's wheels on the road, from where the camera came nearest."""
        height, config = self.setup.height_above_ground_m, self.setup.objects
        away = float(np.linalg.norm(self.path[self.frame_ids[-1]].translation - landmark.world_from_object.translation))
        if height is None or away > self.setup.slam.nearer * landmark.nearest_m:
            return
        landmark.nearest_m = away
        sigma = float(np.hypot(config.ground_height_sigma_m, config.ground_slope_sigma * away))
        below = height + float(self.vertices(landmark)[:, 2].min())
        self.smoother.measurements.add_road_height(landmark.number, self.smoother.frame, below, sigma)

    def _test_motion(self, landmark: Landmark) -> None:
        """Take an object back that turns out to move, now that more of it was seen."""
        number, config = landmark.number, self.setup.objects
        rows = self.smoother.objects.linear_observations(number)
        views = [LinearView(self.times_s[f], j, r) for f, j, r in rows]
        if len(views) < self.setup.slam.motion_views:
            return
        velocity, gain = fit_velocity(views, landmark.world_from_object.rotation, landmark.z)
        if float(np.linalg.norm(velocity)) > config.max_speed_m_s and gain > config.motion_gain:
            landmark.moves = True
            self.moving.add(landmark.track)
            self.in_view.pop(landmark.track, None)
            self.smoother.forget(number)

    def _retire(self) -> None:
        """Let old states go; landmarks that leave stay where they now are in the map."""
        leaving = [n for n in self.in_view.values() if self.smoother.leaves_next(n)]
        covariances = {number: self.landmark_covariance(number) for number in leaving}
        self.smoother.retire()
        for track, number in list(self.in_view.items()):
            if not self.smoother.objects.holds(number):
                landmark = self.landmarks[number]
                landmark.in_map = self.odometry_frame.map_from_odometry @ landmark.world_from_object
                landmark.pose_covariance = covariances.get(number)
                del self.in_view[track]

    def _close_loops(self) -> None:
        """Join landmarks in view with older ones, and lay the odometry's world anew in the map."""
        if len(self.path) > 1:
            last, now = (self.path[f].translation for f in self.frame_ids[-2:])
            self.odometry_frame.travel(float(np.linalg.norm(now - last)))
        if not self.setup.slam.loop_closure.enabled:
            return
        in_view, config = set(self.in_view.values()), self.setup.slam.loop_closure
        found = find_loop_closure(self.landmarks, in_view, self.joined, self.odometry_frame, config)
        if found is not None:
            self.joined += found.pairs
            self.odometry_frame.close(found.correction, (self.landmarks[old] for _, old in found.pairs))


def _road(setup: SlamSetup, image_features: ImageFeatures | None) -> RoadDisplacements | None:
    height = setup.height_above_ground_m
    if image_features is None or not setup.slam.road.enabled or height is None:
        return None
    return RoadDisplacements(setup.camera, height, setup.slam.road)
