"""Localization in a map of meshes: predict by IMU, associate, correct, gate, smooth (paper, Sec. IV-D)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from meshslam.geometry import Camera, Pose, View
from meshslam.geometry.arrays import Floats
from meshslam.localization.belief import SmootherBelief
from meshslam.localization.config import LocalizationConfig
from meshslam.localization.correction import Correction, Sighting, correct
from meshslam.localization.factors import SeenObject, place_camera
from meshslam.localization.frame_masks import FrameMasks, associate, frame_views, in_view
from meshslam.localization.gtsam_bridge import adjoint
from meshslam.localization.imu import Interval, Mounting, NavState, Preintegrator, predict
from meshslam.localization.known_objects import KnownObject
from meshslam.localization.smoother import Smoother
from meshslam.localization.start_factors import start_covariance
from meshslam.mapping.config import MappingConfig
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples

_PROCESS_SIGMAS = np.array([0.01] * 3 + [1e-3] * 3)  # what one prediction adds to a frame's pose


@dataclass(frozen=True, eq=False)
class FrameReport:
    """What one frame brought."""

    frame: int
    predicted: Pose  # world_from_camera by the IMU from the frame before
    corrected: Pose  # after this frame's update
    object_of_detection: dict[int, int]
    refused: tuple[int, ...]  # objects whose views did not agree
    has_gap: bool


@dataclass
class Localizer:
    """The camera in a known map; feed it frames in the order of their times."""

    camera: Camera
    objects: Sequence[KnownObject]
    mounting: Mounting
    keypoint_names: Mapping[str, tuple[str, ...]]
    config: LocalizationConfig
    path: dict[int, Pose] = field(default_factory=dict)  # world_from_camera of every frame, as last seen
    moved: dict[int, int] = field(default_factory=dict)  # object to the frame at which it was found moved

    def __post_init__(self) -> None:
        self._preintegrator = Preintegrator(self.config.imu)
        self._smoother = Smoother(self.config.imu, self.config.start, self.config.smoother, self.mounting)
        self._noise = replace(self.config.noise, keypoint_position_sigma_m=self.config.keypoint_position_sigma_m)
        self._views = MappingConfig(edge_margin_px=self.config.edge_margin_px, crop_margin=0.2)
        self._state: NavState | None = None
        self._covariance = np.zeros((6, 6))
        self._refusals: dict[int, int] = {}

    def begin(self, frame: int, state: NavState, imu: ImuSamples, detections: tuple[Detection, ...]) -> FrameReport:
        """The first frame, whose state is known."""
        rate = np.array([np.interp(state.time_s, imu.times_s, c) for c in imu.angular_rate_rad_s.T])
        self._smoother.begin(state, rate)
        self._frame_ids = [frame]
        covariance = start_covariance(self.config.start, state.world_from_imu)
        return self._see(frame, state, rate, covariance, detections, has_gap=False)

    def process(self, frame: int, time_s: float, imu: ImuSamples, detections: tuple[Detection, ...]) -> FrameReport:
        """The next frame, `imu` holding the samples since the last one."""
        assert self._state is not None
        last = self._state
        interval = self._preintegrator.between(imu, last.time_s, time_s, last)
        state = predict(last, interval, time_s)
        self._smoother.advance(state, interval)
        self._frame_ids.append(frame)
        covariance = self._carried(last, state, interval)
        return self._see(frame, state, interval.angular_rate_rad_s, covariance, detections, has_gap=interval.has_gap)

    def first_state(self) -> NavState:
        """The first frame's state as it is now seen, while the lag still holds it."""
        return self._smoother.estimate(0).state

    @property
    def current_mounting(self) -> Mounting:
        """How the camera is mounted, as it is now seen."""
        return self._smoother.mounting()

    @property
    def velocity_and_covariance(self) -> tuple[Floats, Floats]:
        """The newest velocity (3,) of the IMU, and the covariance (6, 6) of its pose."""
        assert self._state is not None
        return self._state.velocity_in_world, self._covariance

    def belief(self) -> SmootherBelief:
        """All that is believed of the newest state; the window ends with this."""
        return self._smoother.belief()

    def resume(self, belief: SmootherBelief) -> None:
        """Go on from what was believed."""
        self._smoother.resume(belief)
        self._frame_ids = [-1]
        self._state = belief.state
        self._covariance = self._smoother.pose_covariance(0)

    def _carried(self, last: NavState, state: NavState, interval: Interval) -> Floats:
        """Covariance of the predicted pose: the last one moved along, with the uncertainty of velocity and IMU."""
        step = state.world_from_imu.inverse() @ last.world_from_imu
        moved = adjoint(step) @ self._covariance @ adjoint(step).T
        added = interval.measurements.preintMeasCov()[:6, :6]
        grown = np.diag(np.square(_PROCESS_SIGMAS))
        grown[:3, :3] += added[3:6, 3:6]
        grown[3:, 3:] += added[:3, :3]
        return moved + grown

    def _see(
        self,
        frame: int,
        state: NavState,
        rate: Floats,
        covariance: Floats,
        detections: tuple[Detection, ...],
        *,
        has_gap: bool,
    ) -> FrameReport:
        mounting = self._smoother.mounting() if self._state is not None else self.mounting
        place = place_camera(
            state.world_from_imu,
            state.velocity_in_world,
            mounting.imu_from_camera,
            mounting.time_offset_s,
            rate - state.gyroscope_bias,
        )
        camera_covariance = place.by_imu @ covariance @ place.by_imu.T
        usable = tuple(d for d in detections if max(d.bbox[2:]) >= self.config.minimum_box_px)
        masks = FrameMasks(self.camera, usable)
        matched, views = self._match(masks, place.pose)
        sightings = self._sightings(matched, views)
        kept, refused, corrected = self._agreeing(place.pose, camera_covariance, sightings)
        self._smoother.start_at(corrected)
        self._count([matched[k].id for k in refused], [matched[k].id for k in kept], frame)
        for detection_id in kept:
            thing, sighting = matched[detection_id], sightings[detection_id]
            self._smoother.see(sighting.seen, thing.id, thing.world_from_object, sighting.covariance)
        self._smoother.update()
        self._remember()
        ids = {k: matched[k].id for k in kept}
        gone = tuple(sorted(matched[k].id for k in refused))
        return FrameReport(frame, place.pose, self.path[frame], ids, gone, has_gap)

    def _match(self, masks: FrameMasks, pose: Pose) -> tuple[dict[int, KnownObject], dict[int, View]]:
        usable = [o for o in self.objects if o.id not in self.moved]
        expected = in_view(self.camera, pose, usable, self.config.association.largest_distance_m)
        matched = associate(masks, pose, expected, self.config.association)
        return matched, frame_views(masks, pose, matched, expected, self.keypoint_names, self._views)

    def _sightings(self, matched: Mapping[int, KnownObject], views: Mapping[int, View]) -> dict[int, Sighting]:
        found = {}
        for detection_id, view in views.items():
            thing = matched[detection_id]
            seen = SeenObject(thing.model, view, self._noise, self.camera.fx)
            covariance = thing.pose_covariance if self.config.use_map_covariance else None
            found[detection_id] = Sighting(seen, thing.world_from_object, covariance)
        return found

    def _agreeing(
        self, pose: Pose, covariance: Floats, sightings: Mapping[int, Sighting]
    ) -> tuple[list[int], list[int], Pose]:
        """Detections whose views agree, the worst left out until all do; those left out; the pose then."""
        kept, refused, corrected = dict(sightings), [], pose
        while kept:
            found: Correction = correct(pose, covariance, kept)
            corrected = found.world_from_camera
            worst = max(found.cost_shares, key=lambda k: found.cost_shares[k])
            if found.cost_shares[worst] <= self.config.gate.largest_cost:
                break
            refused.append(worst)
            del kept[worst]
        return list(kept), refused, corrected if kept else pose

    def _count(self, refused: list[int], agreed: list[int], frame: int) -> None:
        """An object whose views are refused again and again was moved: what it said in the window is taken back."""
        for number in agreed:
            self._refusals[number] = 0
        for number in refused:
            self._refusals[number] = self._refusals.get(number, 0) + 1
            if self._refusals[number] >= self.config.gate.moved_views:
                self.moved[number] = frame
                self._smoother.forget(number)

    def _remember(self) -> None:
        """Take over what the smoother now says of the frames that it holds."""
        for index in self._smoother.frames:
            self.path[self._frame_ids[index]] = self._smoother.estimate(index).world_from_camera
        self._state = self._smoother.estimate(self._smoother.frame).state
        self._covariance = self._smoother.pose_covariance(self._smoother.frame)
        self._smoother.close()
