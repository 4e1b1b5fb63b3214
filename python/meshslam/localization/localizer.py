"""Localization as a robot uses it: frames and IMU samples in, poses out; saved and loaded as a whole."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from meshslam.categories import category_names, load_category
from meshslam.errors import MapError, SequenceError
from meshslam.geometry import Bytes, Camera, Floats, Pose
from meshslam.graph import StateMarginal, unchanged, unchanged_by_errors
from meshslam.initialization import EstimationConfig, FirstFrames, settling_seconds
from meshslam.localization.archive import archive_errors, read_archive, under, write_archive
from meshslam.localization.config import LocalizationConfig
from meshslam.localization.estimator import FrameReport, LocalizationEstimator
from meshslam.localization.local_mapping import MakeLocalMapping, PlaceSearch, no_local_mapping
from meshslam.localization.map_models import KnownMap
from meshslam.localization.relocalization import MapStart, explained, settled_in_map, start_in_map
from meshslam.localization.stream import Stream
from meshslam.maps import Map, TiledMap
from meshslam.motion import Mounting, NavState, rate_at, state_of_camera
from meshslam.perception import Detection, FramePerception, KeypointConfig, Segmenter, SegmenterConfig, TrackerConfig
from meshslam.plausibility import RatesBySight
from meshslam.sequences import ImuSamples, InitialState

FORMAT = "meshslam-localizer-3"


class LocalizerSettings(Protocol):
    """The part of `Config` that localization uses."""

    @property
    def localization(self) -> LocalizationConfig:
        """Of localization alone."""

    @property
    def estimation(self) -> EstimationConfig:
        """Of IMU, start and smoother."""

    @property
    def segmentation(self) -> SegmenterConfig:
        """Of the segmentation network."""

    @property
    def keypoints(self) -> KeypointConfig:
        """Of the key point network."""

    @property
    def tracking(self) -> TrackerConfig:
        """Of the tracker."""


@dataclass(frozen=True)
class _DefaultSettings:
    localization: LocalizationConfig = field(default_factory=LocalizationConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    segmentation: SegmenterConfig = field(default_factory=SegmenterConfig)
    keypoints: KeypointConfig = field(default_factory=KeypointConfig)
    tracking: TrackerConfig = field(default_factory=TrackerConfig)


@dataclass(frozen=True, eq=False)
class LocalizerState:
    """Where the camera is.

    Pose, velocity and covariance are None while the localizer has not started: without a given start it collects the
    first seconds, finds the start in the map, and then processes them at once.
    """

    frame: int
    time_s: float
    world_from_camera: Pose | None
    velocity_in_world: Floats | None  # (3,), of the IMU, m/s
    covariance: Floats | None  # (6, 6) of world_from_imu, right perturbation, (translation, rotation), m and rad
    objects: tuple[int, ...]  # of the map, seen in this frame
    moved: tuple[int, ...]  # objects that were found moved so far
    has_imu_gap: bool = False
    notes: tuple[str, ...] = ()  # what of the frame's samples and detections was left out, and why
    camera_covariance: Floats | None = None  # (6, 6) of world_from_camera, likewise

    @property
    def is_started(self) -> bool:
        """Whether there is a pose."""
        return self.world_from_camera is not None


@dataclass(frozen=True, eq=False)
class _Frame:
    number: int
    time_s: float
    detections: tuple[Detection, ...]


class Localizer:
    """The camera in a known map, frame by frame, by an IMU and the objects that frames show.

    Frames bring images, detections, or both; images are undistorted, BGR (h, w, 3). The world is the map's, z up.
    Lengths are in metres, times in seconds; covariances are those of right perturbations (translation, rotation), m and
    rad. MapError if the map cannot be used; `process`, `save` and `load` say what they raise.

    Example:
        localizer = meshslam.Localizer(
            drive.camera, meshslam.Map.load("run"), imu_from_camera=drive.imu_from_camera
        )
        state = localizer.process(time_s=12.3, imu=samples, detections=detections)
        state.world_from_camera  # Pose, or None before the first seconds were found in the map

    """

    def __init__(
        self,
        camera: Camera,
        map: Map | TiledMap,
        *,
        imu_from_camera: Pose,
        start: InitialState | None = None,
        segmenter: Segmenter | Path | str | None = None,
        adapter: Path | str | None = None,
        classes: Mapping[str, str] | None = None,
        keypoint_names: Mapping[str, Sequence[str]] | None = None,
        config: LocalizerSettings | None = None,
        local_mapping: MakeLocalMapping | None = None,
        source: str = "stream",
    ) -> None:
        """`adapter` (YAML) says how the network is fed and read, `classes` its classes that are others of ours.

        Such as {"vehicle": "car"}. `keypoint_names` are their order in given detections, by category; the shipped
        categories' own if not given.

        Without a `start` the first seconds are looked for in the map. In a map in tiles of more than 1,000 objects
        `local_mapping` is needed for that: meshslam.object_slam.SlamLocalMapping. `source` is what messages call the
        stream.
        """
        self._settings, self._given_start, self._source = config or _DefaultSettings(), start, source
        self._camera, self._imu_from_camera = camera, imu_from_camera
        self._known = KnownMap(map, self._settings.localization.association.max_distance_m)
        self._local_mapping = local_mapping
        self._search: PlaceSearch | None = None
        self._search_note: tuple[str, ...] = ()
        self._searched_s = -np.inf  # samples until then have gone into the search
        if start is None and self._known.is_large and local_mapping is None:
            raise MapError(no_local_mapping(self._known))
        self._names = _shipped_names() if keypoint_names is None else {k: tuple(v) for k, v in keypoint_names.items()}
        settings = self._settings
        self._perception = FramePerception(
            segmenter,
            settings.segmentation,
            settings.keypoints,
            settings.tracking,
            camera,
            {name: len(points) for name, points in self._names.items()},
            adapter,
            classes,
        )
        self._stream = Stream(source=source, sight=RatesBySight(camera, imu_from_camera))
        self._waiting: list[_Frame] = []
        self._estimator: LocalizationEstimator | None = None
        self._moved: dict[int, int] = {}

    def process(
        self,
        *,
        time_s: float,
        image: Bytes | None = None,
        imu: ImuSamples | None = None,
        detections: Sequence[Detection] | None = None,
        frame: int | None = None,
    ) -> LocalizerState:
        """Take the next frame, with the IMU samples since the last one.

        `detections` are used as they are; `frame` is its number, counted on if it is not given. Samples may come in any
        order, and doubled; those that are no numbers, wild (over 10 g) or frozen are left out, as `notes` of the state
        says. Frames and samples may be missing: the gap is bridged. The first frame needs no samples: it waits for
        them.

        Whatever is raised, the state is as before the call: go on with the next frame, or send this one again.
        SequenceError if time or number do not go on or jump, if samples come too late, are on another clock or in
        another unit, if the frame cannot be taken in, or if the map explains nothing of the first seconds;
        DetectionError for detections of another image size or with other key points; GeometryError for an image that is
        not uint8 (h, w, 3) of the camera's size; ModelError for a network. All are MeshslamErrors; nothing else is
        raised.
        """
        number = self._stream.checked_number(frame)
        with unchanged_by_errors(self, f"{self._source}: frame {number}"):
            self._stream.take(number, time_s, imu, needs_imu=True)
            given = _Frame(number, float(time_s), self._perception.process(number, image, detections))
            self._stream.see(number, given.time_s, given.detections)
            reached = self._taken(given)
            _check_finite(number, reached.world_from_camera)
            return replace(reached, notes=(*self._stream.notes, *self._perception.notes, *self._search_note))

    def _taken(self, given: _Frame) -> LocalizerState:
        if self._estimator is not None:
            return self._step(given)
        self._waiting.append(given)
        if self._given_start is None and self._known.is_large:
            return self._looked(given)
        if self._suffices():
            return self._begin(*self._start())
        return LocalizerState(given.number, given.time_s, None, None, None, (), ())

    def _looked(self, given: _Frame) -> LocalizerState:
        """The next frame of a search in a large map, which begins anew where many frames have shown nothing."""
        assert self._local_mapping is not None
        if self._search is None:
            mapping = self._local_mapping(self._camera, self._imu_from_camera, self._names, self._source)
            self._search = PlaceSearch(self._known, mapping, self._settings.localization.relocalization)
        search, settings = self._search, self._settings
        imu = self._stream.samples().between(self._searched_s, np.inf)
        self._searched_s, self._search_note = float(self._stream.samples().times_s[-1]), ()
        found = search.take(given.number, given.time_s, imu, given.detections)
        if found is not None:
            start = self._map_start()
            state = explained(start, self._known, found, settings.localization)
            if state is not None:
                self._search = None
                return self._begin(*settled_in_map(start, state, self._fresh, settings.estimation))
        if search.is_over(given.time_s):
            self._search, self._waiting = None, []
            self._search_note = (f"the place was not found in the map, the search begins anew: {search.refused}",)
        return LocalizerState(given.number, given.time_s, None, None, None, (), ())

    def save(self, path: Path | str) -> None:
        """Write the newest state with its joint covariance, and which objects moved (.npz).

        The smoothing of the last seconds ends here; what they say of the newest state is kept. It continues here, and
        where it is loaded, with the same results. SequenceError before it has started.
        """
        if self._estimator is None:
            raise SequenceError("nothing to save: no frame was processed yet, or localization has not started")
        with unchanged_by_errors(self, f"{self._source}: cannot be saved"):
            self._save(Path(path), self._estimator)

    def _save(self, path: Path, estimator: LocalizationEstimator) -> None:
        marginal, moved = estimator.marginal(), sorted(estimator.moved.items())
        plain = {"last_s": self._stream.last_s, "next_number": self._stream.next_number, "moved": moved}
        arrays: dict[str, Any] = {"own": np.array(json.dumps(plain))}
        arrays |= {f"marginal_{k}": v for k, v in marginal.arrays().items()}
        arrays |= {f"perception_{k}": v for k, v in self._perception.to_arrays().items()}
        write_archive(path, FORMAT, self._stream.samples(), arrays)
        self._fill(arrays, self._stream.samples())

    @classmethod
    def load(cls, path: Path | str, camera: Camera, map: Map | TiledMap, **told: Any) -> Localizer:  # noqa: ANN401 # as given
        """Go on where `save` ended; `told` as when it was made. MapError if the file is none of its."""
        imu, arrays = read_archive(Path(path), FORMAT)
        localizer = cls(camera, map, **told)
        with archive_errors(path):
            localizer._fill(arrays, imu)
        return localizer

    def __getstate__(self) -> dict[str, Any]:
        """For copies and pickles: they go on from the newest state and its covariance, as what is saved does.

        The smoothing of the last seconds begins anew in the copy; the original goes on as if it had not been copied.
        """
        if self._estimator is None:
            return dict(vars(self))
        with unchanged(self):
            marginal, moved = self._estimator.marginal(), dict(self._estimator.moved)
        return vars(self) | {"_estimator": None, "_copied": (marginal, moved)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """The reverse of `__getstate__`."""
        copied = state.pop("_copied", None)
        vars(self).update(state)
        if copied is not None:
            self._estimator = self._fresh(self._settings.estimation)
            self._estimator.moved = dict(copied[1])
            self._estimator.resume(copied[0])

    def _fill(self, arrays: Mapping[str, Any], imu: ImuSamples) -> None:
        plain = json.loads(str(arrays["own"]))
        self._stream.restore(imu, plain["last_s"], plain["next_number"])
        self._perception.fill(under("perception_", arrays))
        self._estimator = self._fresh(self._settings.estimation)
        self._estimator.moved = {int(n): int(f) for n, f in plain["moved"]}
        self._estimator.resume(StateMarginal.from_arrays(under("marginal_", arrays)))

    def _fresh(self, estimation: EstimationConfig) -> LocalizationEstimator:
        mounting, config = Mounting(self._imu_from_camera), self._settings.localization
        return LocalizationEstimator(
            self._camera, self._known, mounting, self._names, estimation, config, keep_path=False
        )

    def _suffices(self) -> bool:
        if not self._stream.has_samples():
            return False
        if self._given_start is not None:
            return True
        estimation = self._settings.estimation
        unknown, lag_s = estimation.unknown_start, estimation.smoother.lag_s
        seconds = max(unknown.alignment.seconds, settling_seconds(unknown, lag_s))
        return self._waiting[-1].time_s - self._waiting[0].time_s > seconds

    def _begin(self, state: NavState, estimation: EstimationConfig) -> LocalizerState:
        """Go through the frames that waited for the first state."""
        self._estimator = self._fresh(estimation)
        first, *rest = self._waiting
        self._waiting = []
        report = self._estimator.begin(first.number, state, self._stream.samples(), first.detections)
        reached = self._reported(first, report)
        for frame in rest:
            reached = self._step(frame)
        return reached

    def _start(self) -> tuple[NavState, EstimationConfig]:
        imu, settings, given = self._stream.samples(), self._settings, self._given_start
        first, estimation = self._waiting[0], settings.estimation
        if given is not None:
            pose, velocity, rate = given.world_from_camera, given.velocity_in_world, rate_at(imu, first.time_s)
            return state_of_camera(first.time_s, pose, velocity, rate, self._imu_from_camera), estimation
        return start_in_map(self._map_start(), self._known, self._fresh, estimation, settings.localization)

    def _map_start(self) -> MapStart:
        frames = FirstFrames(
            self._camera,
            tuple(f.number for f in self._waiting),
            np.array([f.time_s for f in self._waiting]),
            None,
            self._source,
        )
        by_frame = {f.number: f.detections for f in self._waiting}
        tracked = [d for f in self._waiting for d in f.detections]
        return MapStart(frames, self._stream.samples(), self._imu_from_camera, by_frame, tracked, self._names)

    def _step(self, frame: _Frame) -> LocalizerState:
        assert self._estimator is not None
        report = self._estimator.process(frame.number, frame.time_s, self._stream.samples(), frame.detections)
        self._stream.forget_before(frame.time_s)
        return self._reported(frame, report)

    def _reported(self, frame: _Frame, report: FrameReport) -> LocalizerState:
        assert self._estimator is not None
        velocity, covariance = self._estimator.velocity_and_covariance
        of_camera = self._estimator.camera_covariance
        seen, moved = sorted(report.object_of_detection.values()), sorted(self._estimator.moved)
        at = (frame.number, frame.time_s, report.corrected, velocity, covariance)
        return LocalizerState(*at, tuple(seen), tuple(moved), report.has_gap, camera_covariance=of_camera)


def _check_finite(number: int, pose: Pose | None) -> None:
    if pose is not None and not np.isfinite(pose.matrix).all():
        raise SequenceError(f"frame {number}: the pose is not finite: what the frame brought was left out again")


def _shipped_names() -> dict[str, tuple[str, ...]]:
    return {name: load_category(name).keypoint_names for name in category_names()}
