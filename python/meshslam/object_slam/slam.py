"""SLAM as a robot uses it: frames and IMU samples in, poses and meshes out; saved and loaded in the middle."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from meshslam.categories import Category, load_category
from meshslam.errors import SequenceError
from meshslam.features import FrameFeatures, ImageFeatures
from meshslam.geometry import Bytes, Camera, Floats, Pose
from meshslam.graph import CameraPrediction, FullTrajectory, ObjectCovariance, StartConfig, unchanged_by_errors
from meshslam.initialization import EstimationConfig
from meshslam.localization import Stream, archive_errors, read_archive, under, write_archive
from meshslam.mapping import MappingConfig, ObjectMapping
from meshslam.maps import Map, MapObject, Trajectory, TrajectoryEstimate
from meshslam.motion import ImageMotion, ImuMotion, MotionSource, Mounting, NavState, OdometryMotion
from meshslam.object_slam.archive import (
    detection_from_plain,
    detection_to_plain,
    estimator_from_arrays,
    estimator_to_arrays,
    packed_json,
    state_from_plain,
    state_to_plain,
    unpacked_json,
)
from meshslam.object_slam.config import SlamConfig
from meshslam.object_slam.estimator import SlamEstimator, SlamReport
from meshslam.object_slam.landmarks import Landmark, joined_tracks
from meshslam.object_slam.map_covariances import with_path_covariances
from meshslam.object_slam.refinement import best_landmarks, refined_mapping, starts_of
from meshslam.object_slam.result import SlamResult, SlamState
from meshslam.object_slam.setup import SlamSetup
from meshslam.object_slam.start import NO_IMU, FirstSeconds, SettlingStart, StreamFrame
from meshslam.objects import ObjectConfig
from meshslam.perception import (
    CategoryEntry,
    Detection,
    DetectionSet,
    FramePerception,
    ImageEntry,
    KeypointConfig,
    Segmenter,
    SegmenterConfig,
    TrackerConfig,
)
from meshslam.plausibility import RatesBySight
from meshslam.sequences import ImuSamples, InitialState

FORMAT = "meshslam-slam-7"
Progress = Callable[[str, int, int], None]


class SlamSettings(Protocol):
    """The part of `Config` that SLAM uses."""

    @property
    def slam(self) -> SlamConfig:
        """Of SLAM alone."""

    @property
    def estimation(self) -> EstimationConfig:
        """Of IMU, start and smoother."""

    @property
    def objects(self) -> ObjectConfig:
        """Of one object's estimate."""

    @property
    def mapping(self) -> MappingConfig:
        """Of which tracks become objects."""

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
class SlamParts:
    """The part alone, at its defaults unless it is told otherwise."""

    slam: SlamConfig = field(default_factory=SlamConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    objects: ObjectConfig = field(default_factory=ObjectConfig)
    mapping: MappingConfig = field(default_factory=MappingConfig)
    segmentation: SegmenterConfig = field(default_factory=SegmenterConfig)
    keypoints: KeypointConfig = field(default_factory=KeypointConfig)
    tracking: TrackerConfig = field(default_factory=TrackerConfig)


class Slam:
    """The camera among objects that are not known before, frame by frame.

    The camera is moved by an IMU (`imu_from_camera`), by poses given with the frames (`by_odometry`), or by the
    images alone. Frames bring images, detections, or both; images are undistorted, BGR (h, w, 3). With images the
    network `segmenter` finds the objects, the shipped one their key points, and a tracker follows them; point tracks
    and the road measure the camera's motion.

    The world is z up: that of `start`; without a start the first camera is its origin, with x ahead, and the first
    three seconds of frames have no pose yet. Lengths are in metres, times in seconds; covariances are those of right
    perturbations (translation, rotation), m and rad. CategoryError if the category cannot be found; `process`, `save`
    and `load` say what they raise.

    Example:
        slam = meshslam.Slam(
            drive.camera, imu_from_camera=drive.imu_from_camera, segmenter="yolov5n-seg.onnx"
        )
        state = slam.process(image=image, imu=samples, time_s=12.3)
        state.world_from_camera  # Pose, or None before SLAM has started
        {number: car.vertices_in_world for number, car in slam.map().items()}  # (V, 3) each, metres

    """

    def __init__(
        self,
        camera: Camera,
        *,
        category: str | Category = "car",
        imu_from_camera: Pose | None = None,
        by_odometry: bool = False,
        height_above_ground_m: float | None = None,
        start: InitialState | None = None,
        segmenter: Segmenter | Path | str | None = None,
        adapter: Path | str | None = None,
        classes: Mapping[str, str] | None = None,
        keypoint_names: Sequence[str] | None = None,
        config: SlamSettings | None = None,
        source: str = "stream",
    ) -> None:
        """`adapter` (YAML) says how the network is fed and read, `classes` its classes that are others of ours.

        Such as {"vehicle": "car"}. `keypoint_names` is their order in given detections, the category's own if it is
        not given.

        `height_above_ground_m` of the camera, where it is known, is a measure of length. `source` is what messages call
        the stream.
        """
        settings = config or SlamParts()
        known = load_category(category) if isinstance(category, str) else category
        slam, moved_by_imu = settings.slam, imu_from_camera is not None and not by_odometry
        if not moved_by_imu:  # the camera is its own IMU
            slam = replace(slam, time_offset_sigma_s=1e-6, extrinsic_rotation_sigma_deg=1e-4)
        mounted = imu_from_camera if moved_by_imu and imu_from_camera is not None else Pose.identity()
        names = known.keypoint_names if keypoint_names is None else tuple(keypoint_names)
        self._setup = SlamSetup(
            camera,
            known,
            names,
            Mounting(mounted),
            height_above_ground_m,
            slam,
            settings.estimation,
            settings.objects,
            settings.mapping,
        )
        self._moved_by_imu, self._by_odometry = moved_by_imu, by_odometry
        self._given_start, self._source = start, source
        self._perception = FramePerception(
            segmenter,
            settings.segmentation,
            settings.keypoints,
            settings.tracking,
            camera,
            {known.name: len(names)},
            adapter,
            classes,
        )
        self._stream = Stream(source=source, sight=RatesBySight(camera, mounted) if moved_by_imu else None)
        self._image_features: ImageFeatures | None = None
        self._odometry: list[Pose] = []
        self._waiting: list[StreamFrame] = []
        self._settling: SettlingStart | None = None
        self._estimator: SlamEstimator | None = None
        self._detections: dict[int, tuple[Detection, ...]] = {}  # by frame, for the refinement of the map
        self.first_state: NavState  # the first frame's, as it was given or found
        self._filtered: list[Pose] = []
        self._counts = {"frames_with_imu_gap": 0, "frames_without_objects": 0}

    def process(
        self,
        *,
        time_s: float,
        image: Bytes | None = None,
        imu: ImuSamples | None = None,
        detections: Sequence[Detection] | None = None,
        odometry: Pose | None = None,
        frame: int | None = None,
    ) -> SlamState:
        """Take the next frame, with the IMU samples since the last one.

        `detections` are used as they are, and get tracks where they have none; `odometry` is the frame's
        world_from_camera where poses move the camera; `frame` is its number, counted on if it is not given. Samples
        may come in any order, and doubled; those that are no numbers, wild (over 10 g) or frozen are left out, as
        `notes` of the state says. Frames and samples may be missing: the gap is bridged. The first frame needs no
        samples: it waits for them.

        Whatever is raised, the state is as before the call: go on with the next frame, or send this one again.
        SequenceError if time or number do not go on or jump, if samples come too late, are on another clock or in
        another unit, if something is missing, or if the frame cannot be taken in; DetectionError for detections of
        another image size or with other key points; GeometryError for an image that is not uint8 (h, w, 3) of the
        camera's size; ModelError for a network. All are MeshslamErrors; nothing else is raised.
        """
        number = self._stream.checked_number(frame)
        with unchanged_by_errors(self, f"{self._source}: frame {number}"):
            self._check(number, image, odometry)
            tracked = self._perception.process(number, image, detections)
            self._stream.take(number, time_s, imu, needs_imu=self._moved_by_imu)
            self._stream.see(number, float(time_s), tracked)
            reached = self._taken(StreamFrame(number, float(time_s), tracked), image, odometry, None)
            return replace(reached, notes=(*reached.notes, *self._perception.notes))

    def process_tracked(
        self,
        frame: StreamFrame,
        *,
        image: Bytes | None = None,
        imu: ImuSamples | None = None,
        odometry: Pose | None = None,
        progress: Progress | None = None,
    ) -> SlamState:
        """As `process`, with detections that are on tracks and have their key points."""
        with unchanged_by_errors(self, f"{self._source}: frame {frame.number}"):
            self._check(frame.number, image, odometry)
            self._stream.take(frame.number, frame.time_s, imu, needs_imu=self._moved_by_imu, is_live=False)
            return self._taken(frame, image, odometry, progress)

    def process_live(
        self,
        frame: StreamFrame,
        imu: ImuSamples,
        features: FrameFeatures | None,
        late: Mapping[int, tuple[Detection, ...]],
    ) -> SlamState:
        """As `process`, with features and detections that were found elsewhere, meanwhile.

        `features` are those of the frame's image, None in a stream without images; `late` are detections of earlier
        frames, on tracks, by number.
        """
        with unchanged_by_errors(self, f"{self._source}: frame {frame.number}"):
            self._stream.take(frame.number, frame.time_s, imu, needs_imu=self._moved_by_imu)
            if features is not None:
                self._features().put(features)
            self._see_late(late)
            return self._taken(frame, None, None, None, late, is_patient=True)

    def observe_late(self, late: Mapping[int, tuple[Detection, ...]]) -> None:
        """Take in detections of frames that were processed, by number; those that have left the window are kept only.

        As `process_live` takes them, without a new frame.
        """
        with unchanged_by_errors(self, f"{self._source}: detections of frames {', '.join(map(str, late))}"):
            self._see_late(late)
            if self._estimator is not None:
                self._estimator.observe(late)

    def holds(self, frame: int) -> bool:
        """Whether detections of a frame still count for its pose."""
        waits = any(one.number == frame for one in self._waiting)
        return waits or (self._estimator is not None and self._estimator.holds(frame))

    @property
    def next_index(self) -> int:
        """How many frames were taken in: the index of the next one."""
        return len(self._waiting) if self._estimator is None else len(self._estimator.frame_ids)

    @property
    def prediction(self) -> tuple[CameraPrediction, Pose] | None:
        """What the next cameras are predicted from, and map_from_odometry; None before SLAM has started."""
        if self._estimator is None or self._estimator.prediction is None:
            return None
        return self._estimator.prediction, self._estimator.odometry_frame.map_from_odometry

    def _see_late(self, late: Mapping[int, tuple[Detection, ...]]) -> None:
        if self._setup.slam.refine_map:
            self._detections.update(late)
        self._waiting = [
            replace(one, detections=late[one.number]) if one.number in late else one for one in self._waiting
        ]

    def _taken(
        self,
        frame: StreamFrame,
        image: Bytes | None,
        odometry: Pose | None,
        progress: Progress | None,
        late: Mapping[int, tuple[Detection, ...]] | None = None,
        *,
        is_patient: bool = False,
    ) -> SlamState:
        if odometry is not None:
            self._odometry.append(odometry)
        if image is not None:
            self._features().take(image, frame.detections or ())
        if self._setup.slam.refine_map and frame.detections is not None:
            self._detections[frame.number] = frame.detections
        if self._estimator is not None:
            reached = self._step(frame, late)
        else:
            self._wait(frame, late, is_patient=is_patient)
            reached = self._begin(progress) if self._suffices() else self._waiting_state()
        pose = reached.world_from_camera
        if pose is not None and not np.isfinite(pose.matrix).all():
            raise SequenceError(f"frame {frame.number}: the pose is not finite: what it brought was left out again")
        return replace(reached, notes=self._stream.notes)

    def _wait(self, frame: StreamFrame, late: Mapping[int, tuple[Detection, ...]] | None, *, is_patient: bool) -> None:
        """Take in a frame before SLAM has started: the search of a start goes on with it.

        `is_patient`: detections come late, so that a rough start that fails is tried again with the next frames.
        """
        self._waiting.append(frame)
        if self._settling is not None:
            self._settling.settling.take(frame.number, frame.time_s, self._samples(), frame.detections, late)
        elif self._first_seconds().suffice_for_rough_start():
            try:
                self._settling = self._first_seconds().settling(self._fresh)
            except SequenceError:
                if not is_patient or self._suffices():
                    raise

    def _fresh(self, setup: SlamSetup) -> SlamEstimator:
        return SlamEstimator(setup, self._motion(), self._image_features)

    def _suffices(self) -> bool:
        """Whether the frames that wait suffice to start."""
        if self._moved_by_imu and not self._stream.has_samples():
            return False
        return self._first_seconds().suffice()

    def map(self, *, covariances: bool = True) -> Map:
        """The objects as they are now: mesh, pose and its covariance; ids are tracks.

        Meshes are the category's mean with its modes; `finish` fits them once more, with free form. Without
        `covariances`, which take most of the time, objects have none. SequenceError if the graph gives no covariance.
        """
        if self._estimator is None:
            return Map(())
        with unchanged_by_errors(self, f"{self._source}: no map"):
            return self._mapped(self._estimator, covariances=covariances)

    def _mapped(self, estimator: SlamEstimator, *, covariances: bool) -> Map:
        one = joined_tracks(estimator.landmarks, estimator.joined)
        latest = {one.get(m.track, m.track): m for m in estimator.landmarks.values() if m.counts}
        known = estimator.landmark_covariances() if covariances else {}
        to_map = estimator.odometry_frame.map_from_odometry
        things = []
        for track, mark in latest.items():
            pose = to_map @ mark.world_from_object if mark.in_map is None else mark.in_map
            things.append(self._map_object(track, mark, pose, mark.z, known.get(mark.number)))
        return Map(tuple(things))

    def trajectory(self) -> Trajectory:
        """The camera's path so far, each frame as last estimated in the lag; `finish` smooths all of it together."""
        estimator = self._started()
        to_map = estimator.odometry_frame.map_from_odometry
        return Trajectory(np.array(estimator.times_s), tuple(to_map @ estimator.path[f] for f in estimator.frame_ids))

    def camera_covariance(self) -> Floats:
        """Covariance (6, 6) of the newest world_from_camera, right perturbation, (translation, rotation), m and rad."""
        return self._started().camera_covariance()

    def landmarks(self) -> tuple[Landmark, ...]:
        """All landmarks so far, each stay in view by itself."""
        return () if self._estimator is None else tuple(self._estimator.landmarks.values())

    def finish(
        self,
        detections: DetectionSet | None = None,
        world_from_first_camera: Callable[[Pose], Pose] | None = None,
        *,
        fixed_tracks: bool = False,
        progress: Progress | None = None,
    ) -> SlamResult:
        """All frames so far smoothed together, and the map along them; the run can go on.

        The graph's objects are fitted once more along the smoothed path, with free form, who hides whom known from
        their places; tracks that the graph never took in are tried once more (`slam.refine_map`). `detections` are
        those of the whole run, where they are at hand. `world_from_first_camera` takes the first camera's smoothed pose
        to the transform into the world that the result is wanted in. `fixed_tracks`: track ids were given, so that no
        two are joined.
        """
        if self._estimator is None and self._waiting:
            self._begin(progress)
        estimator = self._started()
        full = estimator.finish()
        one = {} if fixed_tracks else joined_tracks(estimator.landmarks, full.joined)
        world = (
            Pose.identity() if world_from_first_camera is None else world_from_first_camera(full.world_from_camera[0])
        )
        times_s = np.array(estimator.times_s)
        path = Trajectory(times_s, tuple(world @ pose for pose in full.world_from_camera))
        found = self._detection_set() if detections is None else detections
        found = found.with_tracks({d.id: one[d.track_id] for d in found.detections if d.track_id in one})
        starts = starts_of(estimator.landmarks, full.world_from_object, one, world)
        best = best_landmarks(estimator.landmarks, one)
        known = full.object_covariances([mark.number for mark in best.values()], world_from_first_camera)
        of_graph = {track: known[mark.number] for track, mark in best.items()}
        estimate = self._estimate(full, path, world, world_from_first_camera)
        began_s = time.perf_counter()
        if self._setup.slam.refine_map:
            mapping, notes = refined_mapping(
                self._setup, estimator.frame_ids, path, found, starts, fixed_tracks=fixed_tracks, progress=progress
            )
            mapping = replace(mapping, map=with_path_covariances(mapping.map, of_graph, estimate))
        else:
            mapping, notes = self._unrefined_mapping(full, found, best, of_graph, world)
        refinement_s = time.perf_counter() - began_s
        filtered = tuple(world @ pose for pose in self._filtered)
        figures = self._figures(estimator, {new for new, _ in full.joined})
        return SlamResult(
            path, filtered, mapping, mapping.detections, figures, notes, refinement_s, world, estimate=estimate
        )

    def _unrefined_mapping(
        self,
        full: FullTrajectory,
        found: DetectionSet,
        best: Mapping[int, Landmark],
        of_graph: Mapping[int, ObjectCovariance],
        world: Pose,
    ) -> tuple[ObjectMapping, tuple[str, ...]]:
        """The objects as the smoothed graph has them, and a note that says so."""
        things = []
        for track, mark in best.items():
            pose, modes = world @ full.world_from_object[mark.number], full.modes[mark.number]
            things.append(self._map_object(track, mark, pose, modes, of_graph[track].whole))
        note = (
            f"map: the {len(things)} objects of the graph as they are, not fitted once more (slam.refine_map is false)"
        )
        return ObjectMapping(Map(tuple(things)), found, (), {}, {}, found), (note,)

    def _estimate(
        self,
        full: FullTrajectory,
        path: Trajectory,
        world: Pose,
        world_from_first_camera: Callable[[Pose], Pose] | None,
    ) -> TrajectoryEstimate:
        """The path with its uncertainty; relative to the first pose where that lays the world."""
        otherwise = "odometry" if self._by_odometry else "imu" if self._moved_by_imu else "images"
        return TrajectoryEstimate(
            path,
            tuple(self._started().frame_ids),
            full.covariances(world_from_first_camera),
            full.velocity_in_world @ world.rotation.T if self._moved_by_imu else _slopes(path),
            full.biases if self._moved_by_imu else None,
            tuple("images" if seen else otherwise for seen in full.observed),
            ~np.array(full.observed, bool),
        )

    def save(self, path: Path | str) -> None:
        """Write the run (.npz): it goes on where it is loaded as it goes on here, and as if it had not been saved.

        SequenceError before it has started.
        """
        if self._stream.last_s is None:
            raise SequenceError("nothing to save: no frame was processed yet")
        with unchanged_by_errors(self, f"{self._source}: cannot be saved"):
            self._save(Path(path))

    def _save(self, path: Path) -> None:
        estimator = self._started()
        arrays = {f"estimator_{k}": v for k, v in estimator_to_arrays(estimator).items()}
        arrays |= {f"perception_{k}": v for k, v in self._perception.to_arrays().items()}
        if self._image_features is not None:
            arrays |= {f"features_{k}": v for k, v in self._image_features.to_arrays().items()}
        arrays |= self._own_arrays()
        write_archive(path, FORMAT, self._stream.samples(), arrays)

    @staticmethod
    def load(path: Path | str, camera: Camera, **told: Any) -> Slam:  # noqa: ANN401 # as given
        """Go on where `save` was; `told` as the run was told when it was made. MapError if the file is none of its."""
        imu, arrays = read_archive(Path(path), FORMAT)
        slam = Slam(camera, **told)
        with archive_errors(path):
            slam._fill(arrays, imu)
        return slam

    def __getstate__(self) -> dict[str, Any]:
        """For copies and pickles, which go on as the original does."""
        if self._estimator is None:
            return vars(self) | {"_settling": None}  # which begins anew from the frames that wait
        return vars(self) | {"_estimator": None, "_copied": estimator_to_arrays(self._estimator)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """The reverse of `__getstate__`."""
        arrays = state.pop("_copied", None)
        vars(self).update(state)
        if arrays is not None:
            self._estimator = SlamEstimator(self._setup, self._motion(), self._image_features)
            estimator_from_arrays(self._estimator, arrays)

    def _own_arrays(self) -> dict[str, Any]:
        plain = {
            "filtered": [pose.matrix.tolist() for pose in self._filtered],
            "odometry": [pose.matrix.tolist() for pose in self._odometry],
            "detections": {f: [detection_to_plain(d) for d in found] for f, found in self._detections.items()},
            "counts": self._counts,
            "last_s": self._stream.last_s,
            "next_number": self._stream.next_number,
            "start": asdict(self._setup.estimation.start),
            "has_images": self._image_features is not None,
            "first_state": state_to_plain(self.first_state),
        }
        return {"own": packed_json(plain)}

    def _fill(self, arrays: Mapping[str, Any], imu: ImuSamples) -> None:
        """Go on from what was saved."""
        plain = unpacked_json(arrays["own"])
        self._stream.restore(imu, plain["last_s"], plain["next_number"])
        self._filtered = [Pose.restored(np.array(m)) for m in plain["filtered"]]
        self._odometry = [Pose.restored(np.array(m)) for m in plain["odometry"]]
        self._detections = {
            int(f): tuple(detection_from_plain(d) for d in found) for f, found in plain["detections"].items()
        }
        self._counts, self._waiting = plain["counts"], []
        self.first_state = state_from_plain(plain["first_state"])
        estimation = replace(self._setup.estimation, start=StartConfig(**plain["start"]))
        self._setup = replace(self._setup, estimation=estimation)
        if plain["has_images"]:
            self._image_features = ImageFeatures(self._setup.slam.points)
            self._image_features.fill(under("features_", arrays))
        self._perception.fill(under("perception_", arrays))
        self._estimator = SlamEstimator(self._setup, self._motion(), self._image_features)
        estimator_from_arrays(self._estimator, under("estimator_", arrays))

    def _check(self, number: int, image: Bytes | None, odometry: Pose | None) -> None:
        """SequenceError if the frame lacks what moves the camera."""
        began = self._stream.last_s is not None
        if began and (image is not None) != (self._image_features is not None):
            what = "no image, but the frames before had one" if image is None else "an image, but the first had none"
            raise SequenceError(f"frame {number}: {what}: give one with every frame or with none")
        if odometry is not None and not (isinstance(odometry, Pose) and np.isfinite(odometry.matrix).all()):
            raise SequenceError(f"frame {number}: odometry is no finite Pose: give world_from_camera, or leave it out")
        if self._by_odometry and odometry is None:
            raise SequenceError(f"frame {number}: no odometry: give world_from_camera of every frame as odometry=…")
        if not self._moved_by_imu and not self._by_odometry and image is None:
            raise SequenceError(
                f"frame {number}: nothing tells how the camera moves: give imu_from_camera and IMU samples, "
                "images, or poses as odometry"
            )

    def _features(self) -> ImageFeatures:
        if self._image_features is None:
            self._image_features = ImageFeatures(self._setup.slam.points)
        return self._image_features

    def _first_seconds(self) -> FirstSeconds:
        imu = self._stream.samples() if self._moved_by_imu else NO_IMU
        odometry = self._odometry if self._by_odometry else []
        features, start = self._image_features, self._given_start
        return FirstSeconds(self._setup, start, self._waiting, imu, odometry, features, self._source)

    def _begin(self, progress: Progress | None = None) -> SlamState:
        """Find the first state, and go through the frames that waited for it."""
        start, self._settling = self._first_seconds().start(self._fresh, self._settling, progress), None
        self.first_state, self._setup = start.state, start.setup
        frames, self._waiting = self._waiting, []
        self._estimator, reports = start.estimator, start.reports
        if self._estimator is None:
            self._estimator = self._fresh(self._setup)
            first = frames[0]
            reports = (self._estimator.begin(first.number, start.state, self._samples(), first.detections or ()),)
        for frame, report in zip(frames, reports, strict=False):
            reached = self._reported(frame, report)
        for frame in frames[len(reports) :]:
            reached = self._step(frame)
        return reached

    def _motion(self) -> MotionSource:
        setup = self._setup
        if self._by_odometry:
            return OdometryMotion(self._odometry, setup.slam.odometry)
        if self._moved_by_imu:
            return ImuMotion(setup.imu)
        return ImageMotion(self._features(), setup.camera, setup.slam.odometry)

    def _samples(self) -> ImuSamples:
        return self._stream.samples() if self._moved_by_imu else NO_IMU

    def _step(self, frame: StreamFrame, late: Mapping[int, tuple[Detection, ...]] | None = None) -> SlamState:
        estimator = self._started()
        report = estimator.process(frame.number, frame.time_s, self._samples(), frame.detections, late)
        oldest = estimator.smoother.frames[0]
        if self._image_features is not None:
            self._image_features.forget_before(oldest)
        self._stream.forget_before(frame.time_s)
        return self._reported(frame, report)

    def _reported(self, frame: StreamFrame, report: SlamReport) -> SlamState:
        estimator = self._started()
        self._filtered.append(report.world_from_camera)
        self._counts["frames_with_imu_gap"] += report.has_gap
        self._counts["frames_without_objects"] += not report.objects
        to_map = estimator.odometry_frame.map_from_odometry
        one = joined_tracks(estimator.landmarks, estimator.joined)
        shown = [mark for mark in map(estimator.landmarks.__getitem__, report.objects) if mark.counts]
        return SlamState(
            frame.number,
            frame.time_s,
            report.world_from_camera,
            to_map,
            to_map.rotation @ estimator.state.velocity_in_world,
            tuple(sorted({one.get(mark.track, mark.track) for mark in shown})),
            len(estimator.joined),
            report.has_gap,
            camera_covariance=report.covariance,
        )

    def _waiting_state(self) -> SlamState:
        newest = self._waiting[-1]
        return SlamState(newest.number, newest.time_s, None, Pose.identity(), None, (), 0)

    def _started(self) -> SlamEstimator:
        if self._estimator is None:
            raise SequenceError(
                f"{self._source}: SLAM has not started: without a start it waits for the first seconds "
                f"({len(self._waiting)} frames so far)"
            )
        return self._estimator

    def _map_object(
        self, number: int, mark: Landmark, pose: Pose, modes: Floats, covariance: Floats | None
    ) -> MapObject:
        setup = self._setup
        vertices = setup.model.vertices(replace(setup.model.state_at(pose), z=modes))
        keypoints = setup.category.keypoints(vertices)
        frames = [f for f, found in self._detections.items() if any(d.track_id == mark.track for d in found)]
        thing = MapObject(
            id=number,
            category=setup.category.name,
            world_from_object=pose,
            vertices=vertices,
            faces=setup.model.faces,
            views=mark.views,
            first_frame=min(frames, default=None),
            last_frame=max(frames, default=None),
            keypoints=dict(zip(setup.category.keypoint_names, keypoints, strict=True)),
            pose_covariance=covariance,
        )
        return thing.recentred()

    def _detection_set(self) -> DetectionSet:
        """All detections so far."""
        width, height = self._setup.camera.width, self._setup.camera.height
        images = tuple(ImageEntry(f, f"{f:06d}.png", width, height) for f in sorted(self._detections))
        every = [d for found in self._detections.values() for d in found]
        names = sorted({d.category for d in every} | {self._setup.category.name})
        own = self._setup.category.name
        points = {name: self._setup.keypoint_names if name == own else () for name in names}
        categories = tuple(CategoryEntry(i + 1, name, points[name]) for i, name in enumerate(names))
        return DetectionSet(images, categories, tuple(replace(d, id=i + 1) for i, d in enumerate(every)))

    def _figures(self, estimator: SlamEstimator, joined: set[int]) -> dict[str, float]:
        road = 0 if estimator.road is None else estimator.road.count
        return {
            "objects_in_graph": len(estimator.landmarks) - len(joined),
            "loop_closures": len(joined),
            "tracks_moving": len(estimator.moving),
            **self._counts,
            # what says how long the path is
            "scale_by_imu": float(self._moved_by_imu),
            "scale_by_odometry": float(self._by_odometry),
            "scale_by_objects": float(len(estimator.landmarks)),
            "scale_by_road_displacements": float(road),
        }


def _slopes(path: Trajectory) -> Floats:
    """Velocities (n, 3) of a path, by differences; 0 for one pose alone."""
    if len(path) < 2:
        return np.zeros((len(path), 3))
    return np.asarray(np.gradient(path.positions_in_world, path.times_s, axis=0), float)
