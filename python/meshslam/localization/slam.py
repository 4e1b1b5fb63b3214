"""Joint SLAM: camera and objects (pose, modes) in one graph, frame by frame, from detections with tracks and IMU."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Camera, ObjectModel, Pose, View
from meshslam.geometry.arrays import Bytes
from meshslam.localization.config import LocalizationConfig, SlamConfig
from meshslam.localization.factors import SeenObject
from meshslam.localization.frame_masks import lowest, touch
from meshslam.localization.imu import Mounting, NavState
from meshslam.localization.landmarks import Landmark, Odometer, growth, known_again_in
from meshslam.localization.motion import ImuMotion, MotionSource, slam_imu
from meshslam.localization.mover import LinearView, velocity_that_explains
from meshslam.localization.pictures import Pictures
from meshslam.localization.road_odometry import RoadOdometry
from meshslam.localization.smoother import Smoother, WholePath
from meshslam.localization.window import Entry
from meshslam.mapping.config import MappingConfig
from meshslam.mapping.ground import road_points
from meshslam.mapping.observations import make_view
from meshslam.mapping.reconstruct import Observed, Reconstruction, Scene, motion, reconstruct
from meshslam.mapping.track import Track, make_views
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples


@dataclass(frozen=True, eq=False)
class Sight:
    """A detection of a track in a frame that the smoother holds."""

    index: int  # of the frame
    detection: Detection
    occluder: Bytes
    view: View


@dataclass
class Candidate:
    """A track that is not an object yet."""

    sights: list[Sight] = field(default_factory=list)
    next_try: int = 0  # number of sights


@dataclass(frozen=True, eq=False)
class SlamReport:
    """What one frame brought."""

    frame: int
    world_from_camera: Pose
    objects: tuple[int, ...]  # seen in the frame and used
    has_gap: bool


@dataclass
class Slam:
    """The camera among objects that are not known before; feed it frames in the order of their times."""

    camera: Camera
    category: Category
    model: ObjectModel
    keypoint_names: tuple[str, ...]
    mounting: Mounting
    height_above_ground_m: float | None
    config: LocalizationConfig
    slam: SlamConfig
    mapping: MappingConfig
    path: dict[int, Pose] = field(default_factory=dict)
    landmarks: dict[int, Landmark] = field(default_factory=dict)
    moving: set[int] = field(default_factory=set)
    same: list[tuple[int, int]] = field(default_factory=list)  # landmarks that are one object
    pictures: Pictures | None = None  # where there are images
    motion: MotionSource | None = None  # by IMU, if none is given

    def __post_init__(self) -> None:
        imu = slam_imu(self.config.imu, self.slam)
        self._motion = self.motion or ImuMotion(imu)
        lag = replace(self.config.smoother, lag_s=self.slam.lag_s)
        self.smoother = Smoother(imu, self.config.start, lag, self.mounting, keep_past=True)
        self._order = [
            self.category.keypoint_names.index(n) if n in self.category.keypoint_names else -1
            for n in self.keypoint_names
        ]
        height, has_road = self.height_above_ground_m, self.pictures is not None and self.slam.road.enabled
        self._road = RoadOdometry(self.camera, height, self.slam.road) if has_road and height is not None else None
        self.candidates: dict[int, Candidate] = {}
        self._views = replace(self.mapping, crop_margin=self.slam.crop_margin)
        self._growth = growth(self.category)
        self.noise = replace(self.mapping.noise, keypoint_position_sigma_m=0.0)  # it is in the views
        self.in_view: dict[int, int] = {}  # by track, the number of its landmark in the window
        self.odometer = Odometer()
        self.frame_ids: list[int] = []
        self.times_s: list[float] = []

    def begin(self, frame: int, state: NavState, imu: ImuSamples, detections: Sequence[Detection]) -> SlamReport:
        """The first frame, whose state is known: it sets the world."""
        self.smoother.begin(state, self._motion.first_rate(imu, state.time_s))
        self.state = state
        return self._see(frame, state.time_s, detections, has_gap=False)

    def process(self, frame: int, time_s: float, imu: ImuSamples, detections: Sequence[Detection]) -> SlamReport:
        """The next frame, `imu` holding the samples since the last one."""
        predicted, interval = self._motion.between(imu, self.state, time_s, self.smoother.frame + 1)
        self.smoother.advance(predicted, interval)
        if self.pictures is not None and self.slam.points.enabled:
            for block in self.pictures.blocks(self.smoother.frame):
                self.smoother.follow_points(block, self.camera, self.slam.points)
        return self._see(frame, time_s, detections, has_gap=interval.has_gap)

    @property
    def ways_on_road(self) -> int:
        """How many steps of the camera the road's texture measured."""
        return 0 if self._road is None else self._road.ways

    def first_state(self) -> NavState:
        """The first frame's state as it is now seen, while the lag still holds it."""
        first = self.smoother.estimate(0).state
        if isinstance(self._motion, ImuMotion) or self.smoother.frame == 0:
            return first
        second = self.smoother.estimate(1).state
        way = second.world_from_imu.translation - first.world_from_imu.translation
        return replace(first, velocity_in_world=way / (second.time_s - first.time_s))

    def finish(self) -> WholePath:
        """All frames so far, smoothed together with all that was seen; the run can go on."""
        return self.smoother.whole_path(self.same, self.slam.whole_iterations)

    def _see(self, frame: int, time_s: float, detections: Sequence[Detection], *, has_gap: bool) -> SlamReport:
        self.frame_ids.append(frame)
        self.times_s.append(time_s)
        self.path[frame] = self.smoother.estimate(self.smoother.frame).world_from_camera
        added: dict[int, tuple[Entry, SeenObject, int]] = {}
        for sight in self._sights(detections):
            track = sight.detection.track_id
            assert track is not None
            number = self.in_view.get(track)
            if number is not None:
                seen = self._seen(sight, self.smoother.object_state(number)[0])
                added[number] = self.smoother.see_shaped(seen, number, sight.index), seen, sight.index
            elif track not in self.moving:
                self.candidates.setdefault(track, Candidate()).sights.append(sight)
        self.smoother.update()
        self._refuse(added)
        if any([self._start(t) for t in list(self.candidates) if self._ready(t)]):
            self.smoother.update()
        if self._road is not None and self.pictures is not None:
            self._road.step(self.smoother, self.pictures)
        self._remember(added)
        self.smoother.close()
        self._leave()
        self._know_again()
        return SlamReport(frame, self.odometer.map_from_odometry @ self.path[frame], tuple(sorted(added)), has_gap)

    def _sights(self, detections: Sequence[Detection]) -> list[Sight]:
        """Views of this frame's tracked detections; what hides them is told by the masks' lowest rows."""
        own = [d for d in detections if d.category == self.category.name and d.track_id is not None]
        masks = {d.id: d.mask() for d in detections}
        found = []
        for detection in own:
            occluder = np.zeros((self.camera.height, self.camera.width), np.uint8)
            for other in detections:
                if other.id != detection.id and touch(other.bbox, detection.bbox) and lowest(other) > lowest(detection):
                    occluder |= masks[other.id]
            found.append(self.sight(self.smoother.frame, detection, occluder))
        return found

    def sight(self, index: int, detection: Detection, occluder: Bytes) -> Sight:
        """A detection in a frame, with what it shows."""
        pose = Pose.identity()
        view = make_view(self.model, self.camera, pose, 0.0, detection, occluder, self._order, self._views)
        return Sight(index, detection, occluder, view)

    def _seen(self, sight: Sight, world_from_object: Pose) -> SeenObject:
        """A view with what the object's own shape and key points add to its noise at the depth where it now is.

        A noise that followed the depth would make all that is nearer and smaller cost less.
        """
        world_from_camera = self.smoother.estimate(sight.index).world_from_camera
        depth_m = max(1.0, float(world_from_camera.inverse().transform(world_from_object.translation)[2]))
        metre_px = self.camera.fx / depth_m
        view = sight.view.with_surface_sigma(self.slam.surface_sigma_m * metre_px)
        view = view.with_keypoint_sigma(self.mapping.noise.keypoint_position_sigma_m * metre_px)
        return SeenObject(self.model, view, self.noise, self.camera.fx)

    def _refuse(self, added: dict[int, tuple[Entry, SeenObject, int]]) -> None:
        """Drop this frame's views that fit badly where all factors agree."""
        bad = []
        for number, (entry, seen, index) in added.items():
            pose, z = self.smoother.object_state(number)
            camera = self.smoother.estimate(index).world_from_camera
            if seen.cost_share(camera.inverse() @ pose, z) > self.slam.largest_cost:
                bad.append(entry)
        if bad:
            self.smoother.window.drop(bad)
            self.smoother.update()

    def _ready(self, number: int) -> bool:
        candidate = self.candidates[number]
        held = set(self.smoother.frames)
        candidate.sights = [s for s in candidate.sights if s.index in held]
        sights = candidate.sights
        if len(sights) < max(self.slam.start_views, candidate.next_try):
            return False
        if sights[-1].index != self.smoother.frame or max(s.detection.bbox[2] for s in sights) < self.slam.start_box_px:
            return False
        first, last = (self.path[self.frame_ids[s.index]].translation for s in (sights[0], sights[-1]))
        return float(np.linalg.norm(last - first)) >= self.slam.start_baseline_m

    def _start(self, track: int) -> bool:
        """Initialize a track's object from its views at the current camera poses; if it fits, it is tied in."""
        candidate = self.candidates[track]
        found = self._reconstructed(candidate)
        if found is None:
            candidate.next_try = len(candidate.sights) + self.slam.retry_views
            return False
        del self.candidates[track]
        if isinstance(found, str):
            self.moving.add(track)
            return False
        pose, z = found.state.world_from_object, found.state.z
        number = len(self.landmarks) + 1
        size = np.ptp(self.model.vertices(found.state), axis=0)
        self.landmarks[number] = Landmark(number, track, pose, z, size, len(candidate.sights))
        self.in_view[track] = number
        self.smoother.add_object(number, pose, z, self._growth, self.slam.size_sigma)
        for sight in candidate.sights:
            self.smoother.see_shaped(self._seen(sight, pose), number, sight.index)
        return True

    def _stand(self, number: int) -> None:
        """Put an object's wheels on the road, as seen from where the camera came nearest."""
        landmark, height = self.landmarks[number], self.height_above_ground_m
        away = float(np.linalg.norm(self.path[self.frame_ids[-1]].translation - landmark.world_from_object.translation))
        if height is None or away > self.slam.nearer * landmark.nearest_m:
            return
        landmark.nearest_m = away
        sigma = float(np.hypot(self.mapping.ground_height_sigma_m, self.mapping.ground_slope_sigma * away))
        state = replace(self.model.state_at(landmark.world_from_object), z=landmark.z)
        below = height + float(self.model.vertices(state)[:, 2].min())
        self.smoother.stand_on_road(number, self.smoother.frame, below, sigma)

    def _reconstructed(self, candidate: Candidate) -> Reconstruction | str | None:
        """The object of a track; "moves" if it does, None if it fits no object yet."""
        sights = candidate.sights
        poses = tuple(self.smoother.estimate(s.index).world_from_camera for s in sights)
        times = np.array([self.times_s[s.index] for s in sights])
        track = Track(0, tuple(s.detection for s in sights), poses, times)
        occluders = {s.detection.id: s.occluder for s in sights}
        views = make_views(
            track,
            self.model,
            self.category,
            self.keypoint_names,
            self.camera,
            lambda d: occluders[d.id],
            self.mapping,
        )
        chosen = sorted({int(i) for i in np.linspace(0, len(sights) - 1, self.mapping.start_views)})
        observed = Observed(track, views, track.subset(chosen), [views[i] for i in chosen])
        road = None
        if self.height_above_ground_m is not None:
            road = road_points([self.path[f] for f in self.frame_ids], self.height_above_ground_m)
        scene = Scene(self.camera, self.category, self.model, self.keypoint_names, road, self.mapping)
        found = reconstruct(observed, scene)
        vertices = self.model.vertices(found.state)
        iou = self.model.mask_ious(views, [found.state.world_from_object], vertices)
        if float(iou.mean()) < self.slam.minimum_mask_iou:
            return None
        velocity, gain = motion(observed, scene, found)
        fast = float(np.linalg.norm(velocity)) > self.mapping.max_speed_m_s
        return "moves" if fast and gain > self.mapping.motion_gain else found

    def _leave(self) -> None:
        """Put landmarks that left the window where they now are in the map."""
        for track, number in list(self.in_view.items()):
            if not self.smoother.holds_object(number):
                landmark = self.landmarks[number]
                landmark.in_map = self.odometer.map_from_odometry @ landmark.world_from_object
                del self.in_view[track]

    def _know_again(self) -> None:
        """Join landmarks in view with older ones, and lay the odometry's world anew in the map."""
        if len(self.path) > 1:
            last, now = (self.path[f].translation for f in self.frame_ids[-2:])
            self.odometer.way_m += float(np.linalg.norm(now - last))
        if not self.slam.revisit.enabled:
            return
        in_view = set(self.in_view.values())
        found = known_again_in(self.landmarks, in_view, self.same, self.odometer, self.slam.revisit)
        if found is not None:
            self.same += found.pairs
            self.odometer.map_from_odometry = found.correction @ self.odometer.map_from_odometry
            self.odometer.known_at_m = self.odometer.way_m

    def _remember(self, added: Iterable[int]) -> None:
        for index in self.smoother.frames:
            self.path[self.frame_ids[index]] = self.smoother.estimate(index).world_from_camera
        self.state = self.smoother.estimate(self.smoother.frame).state
        for number in self.smoother.shaped_objects:
            landmark = self.landmarks[number]
            landmark.world_from_object, landmark.z = self.smoother.object_state(number)
        for number in added:
            self.landmarks[number].views += 1
            self.landmarks[number].last_way_m = self.odometer.way_m
            self._stand(number)
            if self.landmarks[number].views % self.slam.motion_views == 0:
                self._check_motion(number)

    def _check_motion(self, number: int) -> None:
        """Take an object back that turns out to move, now that more of it was seen."""
        landmark = self.landmarks[number]
        views = [LinearView(self.times_s[f], j, r) for f, j, r in self.smoother.views_of(number)]
        if len(views) < self.slam.motion_views:
            return
        velocity, gain = velocity_that_explains(views, landmark.world_from_object.rotation, landmark.z)
        if float(np.linalg.norm(velocity)) > self.mapping.max_speed_m_s and gain > self.mapping.motion_gain:
            landmark.moves = True
            self.moving.add(landmark.track)
            self.in_view.pop(landmark.track, None)
            self.smoother.forget(number)
