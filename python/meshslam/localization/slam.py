"""Joint SLAM: camera and objects (pose, modes) in one graph, frame by frame, from detections with tracks and IMU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Camera, ObjectModel, Pose, View
from meshslam.geometry.arrays import Bytes, Floats
from meshslam.localization.config import LocalizationConfig, SlamConfig
from meshslam.localization.factors import SeenObject
from meshslam.localization.imu import Mounting, NavState
from meshslam.localization.motion import ImuMotion, MotionSource
from meshslam.localization.pictures import Pictures
from meshslam.localization.road_odometry import RoadOdometry
from meshslam.localization.smoother import Smoother
from meshslam.localization.window import Entry
from meshslam.mapping.config import MappingConfig
from meshslam.mapping.ground import road_points
from meshslam.mapping.noise import estimated_noise
from meshslam.mapping.observations import make_view
from meshslam.mapping.reconstruct import Observed, Reconstruction, Scene, motion, reconstruct
from meshslam.mapping.track import Track, make_views
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples

_TOUCH_PX = 8.0


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
    objects: dict[int, tuple[Pose, Floats]] = field(default_factory=dict)  # pose and modes, as last seen
    moving: set[int] = field(default_factory=set)
    pictures: Pictures | None = None  # where there are images
    motion: MotionSource | None = None  # by IMU, if none is given

    def __post_init__(self) -> None:
        imu = replace(
            self.config.imu,
            time_offset_sigma_s=self.slam.time_offset_sigma_s,
            extrinsic_rotation_sigma_deg=self.slam.extrinsic_rotation_sigma_deg,
        )
        self._motion = self.motion or ImuMotion(imu)
        lag = replace(self.config.smoother, lag_s=self.slam.lag_s)
        self._smoother = Smoother(imu, self.config.start, lag, self.mounting)
        self._order = [
            self.category.keypoint_names.index(n) if n in self.category.keypoint_names else -1
            for n in self.keypoint_names
        ]
        height, has_road = self.height_above_ground_m, self.pictures is not None and self.slam.road.enabled
        self._road = RoadOdometry(self.camera, height, self.slam.road) if has_road and height is not None else None
        self._noise, self._left_over = self.mapping.noise, list[Floats]()
        self._candidates: dict[int, Candidate] = {}
        self._frame_ids: list[int] = []
        self._times: list[float] = []

    def begin(self, frame: int, state: NavState, imu: ImuSamples, detections: Sequence[Detection]) -> SlamReport:
        """The first frame, whose state is known: it sets the world."""
        self._smoother.begin(state, self._motion.first_rate(imu, state.time_s))
        self._state = state
        return self._see(frame, state.time_s, detections, has_gap=False)

    def process(self, frame: int, time_s: float, imu: ImuSamples, detections: Sequence[Detection]) -> SlamReport:
        """The next frame, `imu` holding the samples since the last one."""
        predicted, interval = self._motion.between(imu, self._state, time_s, self._smoother.frame + 1)
        self._smoother.advance(predicted, interval)
        if self.pictures is not None and self.slam.points.enabled:
            for block in self.pictures.blocks(self._smoother.frame):
                self._smoother.follow_points(block, self.camera, self.slam.points)
        return self._see(frame, time_s, detections, has_gap=interval.has_gap)

    def first_state(self) -> NavState:
        """The first frame's state as it is now seen, while the lag still holds it."""
        first, second = (self._smoother.estimate(k).state for k in (0, 1))
        if isinstance(self._motion, ImuMotion):
            return first
        way = second.world_from_imu.translation - first.world_from_imu.translation
        return replace(first, velocity_in_world=way / (second.time_s - first.time_s))

    def _see(self, frame: int, time_s: float, detections: Sequence[Detection], *, has_gap: bool) -> SlamReport:
        self._frame_ids.append(frame)
        self._times.append(time_s)
        self.path[frame] = self._smoother.estimate(self._smoother.frame).world_from_camera
        added: dict[int, tuple[Entry, SeenObject, int]] = {}
        for sight in self._sights(detections):
            number = sight.detection.track_id
            assert number is not None
            if self._smoother.holds_object(number):
                seen = self._seen(sight.view)
                added[number] = self._smoother.see_shaped(seen, number, sight.index), seen, sight.index
            elif number not in self.moving:
                self._candidates.setdefault(number, Candidate()).sights.append(sight)
        self._smoother.update()
        self._refuse(added)
        for number in [n for n in self._candidates if self._ready(n)]:
            self._start(number)
        if self._road is not None and self.pictures is not None:
            self._road.step(self._smoother, self.pictures)
        self._remember()
        self._smoother.close()
        return SlamReport(frame, self.path[frame], tuple(sorted(added)), has_gap)

    def _sights(self, detections: Sequence[Detection]) -> list[Sight]:
        """Views of this frame's tracked detections; what hides them is told by the masks' lowest rows."""
        own = [d for d in detections if d.category == self.category.name and d.track_id is not None]
        masks = {d.id: d.mask() for d in detections}
        found = []
        for detection in own:
            occluder = np.zeros((self.camera.height, self.camera.width), np.uint8)
            for other in detections:
                if other.id != detection.id and _touch(other, detection) and _lowest(other) > _lowest(detection):
                    occluder |= masks[other.id]
            pose = Pose.identity()
            view = make_view(self.model, self.camera, pose, 0.0, detection, occluder, self._order, self.mapping)
            found.append(Sight(self._smoother.frame, detection, occluder, view))
        return found

    def _seen(self, view: View) -> SeenObject:
        return SeenObject(self.model, view, self._noise, self.camera.fx)

    def _learn_noise(self, views: list[View], found: Reconstruction) -> None:
        """The masks' noise from what fits leave over, as in mapping."""
        step = self.mapping.noise.outline_step_px
        self._left_over += self.model.border_distances_px(views, found.state, step)
        if self.mapping.estimate_noise:
            self._noise = estimated_noise(self._left_over, self.mapping.border_step_px, self.mapping.noise)

    def _refuse(self, added: dict[int, tuple[Entry, SeenObject, int]]) -> None:
        """Drop this frame's views that fit badly where all factors agree."""
        bad = []
        for number, (entry, seen, index) in added.items():
            pose, z = self._smoother.object_state(number)
            camera = self._smoother.estimate(index).world_from_camera
            if seen.cost_share(camera.inverse() @ pose, z) > self.slam.largest_cost:
                bad.append(entry)
        if bad:
            self._smoother.window.drop(bad)
            self._smoother.update()

    def _ready(self, number: int) -> bool:
        candidate = self._candidates[number]
        held = set(self._smoother.frames)
        candidate.sights = [s for s in candidate.sights if s.index in held]
        sights = candidate.sights
        if len(sights) < max(self.slam.start_views, candidate.next_try):
            return False
        if (
            sights[-1].index != self._smoother.frame
            or max(s.detection.bbox[2] for s in sights) < self.slam.start_box_px
        ):
            return False
        first, last = (self.path[self._frame_ids[s.index]].translation for s in (sights[0], sights[-1]))
        return float(np.linalg.norm(last - first)) >= self.slam.start_baseline_m

    def _start(self, number: int) -> None:
        """Initialize a track's object from its views at the current camera poses, and tie it into the graph."""
        candidate = self._candidates[number]
        found = self._reconstructed(candidate)
        if found is None:
            candidate.next_try = len(candidate.sights) + self.slam.retry_views
            return
        del self._candidates[number]
        if isinstance(found, str):
            self.moving.add(number)
            return
        pose, z = found.state.world_from_object, found.state.z
        self._smoother.add_object(number, pose, z)
        for sight in candidate.sights:
            self._smoother.see_shaped(self._seen(sight.view), number, sight.index)
        if self.height_above_ground_m is not None:
            bottom = float(self.model.vertices(found.state)[:, 2].min())
            away = [float(np.linalg.norm(self._eye(s.index) - pose.translation)) for s in candidate.sights]
            nearest = int(np.argmin(away))
            sigma = float(np.hypot(self.slam.road_sigma_m, self.mapping.ground_slope_sigma * away[nearest]))
            below = self.height_above_ground_m + bottom
            self._smoother.stand_on_road(number, candidate.sights[nearest].index, below, sigma)
        self._smoother.update()

    def _reconstructed(self, candidate: Candidate) -> Reconstruction | str | None:
        """The object of a track; "moves" if it does, None if it fits no object yet."""
        sights = candidate.sights
        poses = tuple(self._smoother.estimate(s.index).world_from_camera for s in sights)
        times = np.array([self._times[s.index] for s in sights])
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
            road = road_points([self.path[f] for f in self._frame_ids], self.height_above_ground_m)
        scene = Scene(self.camera, self.category, self.model, self.keypoint_names, road, self.mapping)
        found = reconstruct(observed, scene)
        vertices = self.model.vertices(found.state)
        iou = self.model.mask_ious(views, [found.state.world_from_object], vertices)
        if float(iou.mean()) < self.slam.minimum_mask_iou:
            return None
        velocity, gain = motion(observed, scene, found)
        fast = float(np.linalg.norm(velocity)) > self.mapping.max_speed_m_s
        if fast and gain > self.mapping.motion_gain:
            return "moves"
        self._learn_noise(views, found)
        return found

    def _eye(self, index: int) -> Floats:
        return self._smoother.estimate(index).world_from_camera.translation

    def _remember(self) -> None:
        for index in self._smoother.frames:
            self.path[self._frame_ids[index]] = self._smoother.estimate(index).world_from_camera
        for number in self._smoother.shaped_objects:
            self.objects[number] = self._smoother.object_state(number)
        self._state = self._smoother.estimate(self._smoother.frame).state


def _touch(one: Detection, other: Detection) -> bool:
    (ax, ay, aw, ah), (bx, by, bw, bh) = one.bbox, other.bbox
    return max(max(ax, bx) - min(ax + aw, bx + bw), max(ay, by) - min(ay + ah, by + bh)) < _TOUCH_PX


def _lowest(detection: Detection) -> tuple[float, float]:
    return round(detection.bbox[1] + detection.bbox[3], 1), detection.bbox[2] * detection.bbox[3]
