"""SLAM at a camera's rate: perception, features and estimation side by side."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from meshslam.categories import Category, load_category
from meshslam.errors import MeshslamError, SequenceError
from meshslam.features import FeatureTracker, FrameFeatures
from meshslam.geometry import Bytes, Camera, Pose
from meshslam.graph import CameraPrediction
from meshslam.live.config import LiveConfig
from meshslam.live.filling import filled
from meshslam.live.imu_log import ImuLog
from meshslam.live.results import IMU, WAITING, WINDOW, LiveCounts, LivePose
from meshslam.live.workers import InOrder, Newest, Worker
from meshslam.localization import checked_samples
from meshslam.maps import Map
from meshslam.motion import NavState
from meshslam.object_slam import Slam, SlamParts, SlamResult, SlamSettings, SlamState, StreamFrame
from meshslam.perception import COLOUR, Detection, FramePerception, Segmenter, find_model, load_segmenter, our_names
from meshslam.sequences import ImuSamples, InitialState

_BEFORE_S = 0.5  # of samples before a state: enough to tell a gap from the usual period
_STALE_S = 10.0  # samples ahead of the frames are held so long at most

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class _Frame:
    """A frame as it was given."""

    number: int
    time_s: float
    image: Bytes | None
    detections: Sequence[Detection] | None
    arrived_s: float  # by time.perf_counter
    is_taken: bool  # the window will take it in


@dataclass(frozen=True, eq=False)
class _Measured:
    """A frame that waits for the window."""

    frame: _Frame
    features: FrameFeatures | None
    run: int  # of the feature tracker: after a frame that failed a new one begins


class LiveSlam:
    """As `Slam`, for a camera that does not wait: every frame gets its pose within `live.deadline_s`.

    Three threads work side by side. The segmentation network takes the newest frame whenever it is free; what it finds
    is put into that frame of the window. Point tracks are followed from frame to frame. The window takes frames in one
    after the other; frames that come while it is busy are skipped, and their poses follow from the IMU. `on_pose` is
    called for every frame in its order, from a fourth thread.

    `add_imu` and `add_frame` never wait; queues are bounded, and `counts` tells what was skipped. An IMU is needed.
    Images are undistorted, BGR (h, w, 3). Arguments are those of `Slam`. CategoryError if the category cannot be found,
    ModelError if the network cannot be loaded; `add_frame` and `finish` say what they raise.

    Example:
        live = meshslam.LiveSlam(camera, imu_from_camera=mounting, segmenter="yolov5n-seg.onnx", on_pose=print)
        live.add_imu(samples)  # whenever there are some
        live.add_frame(image, time_s=12.3)
        live.map()  # as it is now
        result = live.finish()  # smoothed, with meshes fitted once more
        live.counts.latency_s(0.95)  # seconds

    """

    def __init__(
        self,
        camera: Camera,
        *,
        imu_from_camera: Pose,
        category: str | Category = "car",
        height_above_ground_m: float | None = None,
        start: InitialState | None = None,
        segmenter: Segmenter | Path | str | None = None,
        adapter: Path | str | None = None,
        classes: Mapping[str, str] | None = None,
        keypoint_names: Sequence[str] | None = None,
        config: SlamSettings | None = None,
        live: LiveConfig | None = None,
        on_pose: Callable[[LivePose], None] | None = None,
        source: str = "live",
    ) -> None:
        """The network is loaded at once: ModelError if it cannot be. `on_pose` must return soon."""
        self._live = live or LiveConfig()
        settings = _for_live(config or SlamParts(), self._live)
        self._mounting, self._source, self._on_pose = imu_from_camera, source, on_pose
        self._imu_config, self._points = settings.estimation.imu, settings.slam.points
        self._fresh = partial(
            Slam,
            camera,
            category=category,
            imu_from_camera=imu_from_camera,
            height_above_ground_m=height_above_ground_m,
            start=start,
            keypoint_names=keypoint_names,
            config=settings,
            source=source,
        )
        self._slam = self._fresh()
        if segmenter is not None and segmenter != COLOUR and isinstance(segmenter, str | Path):
            segmenter = load_segmenter(
                find_model(str(segmenter)),
                settings.segmentation,
                self._live.network_threads,
                adapter=None if adapter is None else Path(adapter),
                renamed=our_names(classes),
                tracked=settings.tracking.categories,
            )
            adapter = classes = None
        known = load_category(category) if isinstance(category, str) else category
        names = known.keypoint_names if keypoint_names is None else tuple(keypoint_names)
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
        self.counts = LiveCounts()
        self._begin()

    def _begin(self) -> None:
        # what threads share
        self._lock = threading.Lock()  # of the estimate
        self._news = threading.Condition()  # of all that follows
        self._error: BaseException | None = None
        self._late: dict[int, tuple[Detection, ...]] = {}  # by frame, that the window has not taken in yet
        self._states: dict[int, SlamState | None] = {}  # by frame; None: it failed
        self._prediction: tuple[CameraPrediction, Pose] | None = None
        self._notes: list[str] = []  # since the last pose
        self._pending = 0  # frames before the window or in it
        self._newest: tuple[Detection, ...] = ()  # of the newest frame that was segmented
        self._run = 0
        self._failed_at: int | None = None  # index at which point tracks begin anew
        # what the caller's thread holds
        self._frames: list[tuple[int, float]] = []
        self._last_taken_s = -np.inf
        self._has_images: bool | None = None
        self._is_closed = False
        # what the window's thread holds
        self._given_s = -np.inf  # samples up to here were taken in
        self._imu = ImuLog()
        self._tracker: FeatureTracker | None = None
        self._to_segment: Newest[_Frame] = Newest()
        self._to_measure: InOrder[_Frame] = InOrder()
        self._to_estimate: InOrder[_Measured] = InOrder()
        self._to_tell: InOrder[_Frame] = InOrder()
        self._workers: list[Worker[Any]] = [
            Worker("perception", self._to_segment, self._segment, self._stop),
            Worker("features", self._to_measure, self._measure, self._stop),
            Worker("window", self._to_estimate, self._estimate, self._stop),
            Worker("poses", self._to_tell, self._tell, self._stop),
        ]

    def add_imu(self, samples: ImuSamples) -> None:
        """Samples since the last ones, by any thread; those that are not after them are left out."""
        self._raise()
        left_out = self._imu.add(checked_samples(len(self._frames), samples))
        with self._news:
            self.counts.imu_left_out += left_out

    def add_frame(
        self,
        image: Bytes | None,
        time_s: float,
        frame: int | None = None,
        *,
        detections: Sequence[Detection] | None = None,
    ) -> None:
        """The next frame, by one thread; `detections` are used instead of the network, where they are given.

        SequenceError if time or number do not go on, if it lacks the image that others have, or if the run is closed;
        GeometryError for an image that is not uint8 (h, w, 3) of the camera's size. What a thread raised is raised
        here, too. Frames that cannot be taken in, and detections that cannot be used, are counted, and notes of the
        next pose say why.
        """
        self._raise()
        if self._is_closed:
            raise SequenceError(f"{self._source}: the run is closed: begin a new one")
        number = self._checked(image, time_s, frame)
        if image is not None:
            self._perception.check(number, image)
        with self._news:
            is_taken = self._can_take(time_s - self._last_taken_s)
            self._pending += is_taken
            self.counts.frames += 1
            self.counts.skipped += not is_taken
        self._frames.append((number, float(time_s)))
        given = _Frame(number, float(time_s), image, detections, time.perf_counter(), is_taken)
        if is_taken:
            self._last_taken_s = given.time_s
            self._to_segment.put(given)
            self._to_measure.put(given)
        if len(self._to_tell) < self._live.pending_poses:
            self._to_tell.put(given)
        else:
            self.counts.dropped_poses += 1

    def _can_take(self, since_s: float) -> bool:
        """Whether the window takes in a frame so long after the last one that it takes in."""
        live = self._live
        if not self.is_started and since_s < live.start_step_s:
            return False
        if self._pending < live.pending_frames:
            return True
        return since_s >= live.busy_step_s and self._pending < live.max_pending_frames

    def map(self, *, covariances: bool = True) -> Map:
        """The objects as they are now, by any thread; see `Slam.map`. It waits for the frame that is being taken in."""
        with self._lock:
            return self._slam.map(covariances=covariances)

    @property
    def is_started(self) -> bool:
        """Whether frames have poses."""
        return self._prediction is not None

    @property
    def first_state(self) -> NavState:
        """The first frame's state, as it was given or found; SequenceError before SLAM has started."""
        if not self.is_started:
            raise SequenceError(f"{self._source}: SLAM has not started: {self._why_not()}")
        return self._slam.first_state

    def _why_not(self) -> str:
        counts = self.counts
        return (
            f"{counts.frames} frames were given, {counts.segmented} segmented, {counts.taken_in} taken in, "
            f"{counts.failed} failed; without a start it waits for the first seconds"
        )

    def finish(
        self, world_from_first_camera: Callable[[Pose], Pose] | None = None, *, progress: Progress | None = None
    ) -> SlamResult:
        """Take in what waits, then smooth and fit everything as `Slam.finish` does; the run is closed.

        The path has all frames from the first one on: those that the window skipped follow from the IMU.
        SequenceError, with counts, if SLAM has not started.
        """
        self.close()
        self._raise()
        with self._lock:
            left = {number: found for number, found in self._late.items() if self._slam.holds(number)}
            self.counts.too_late += len(self._late) - len(left)
            self._late = {}
            if left:
                self._slam.observe_late(left)
            result = self._slam.finish(world_from_first_camera=world_from_first_camera, progress=progress)
        if result.estimate is None:
            return result
        level = result.world_from_graph.inverse()
        estimate = result.estimate.moved(level) if world_from_first_camera is not None else result.estimate
        whole = filled(estimate, self._frames, self._imu.between, self._mounting, self._imu_config)
        whole = whole.moved(result.world_from_graph) if world_from_first_camera is not None else whole
        return replace(result, trajectory=whole.trajectory, estimate=whole)

    def close(self) -> None:
        """End the threads; what was given is done first."""
        if not self._is_closed:
            self._is_closed = True
            for worker in self._workers:
                worker.finish()

    def __enter__(self) -> LiveSlam:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _checked(self, image: Bytes | None, time_s: float, frame: int | None) -> int:
        last = self._frames[-1] if self._frames else None
        number = frame if frame is not None else 0 if last is None else last[0] + 1
        if not np.isfinite(time_s) or (last is not None and (time_s <= last[1] or number <= last[0])):
            before = "" if last is None else f", the one before is frame {last[0]} at {last[1]:.6f} s"
            raise SequenceError(f"{self._source}: frame {number} at {time_s} s: times and numbers must go on{before}")
        if self._has_images is None:
            self._has_images = image is not None
        if self._has_images != (image is not None):
            raise SequenceError(f"{self._source}: frame {number}: give an image with every frame or with none")
        return number

    def _raise(self) -> None:
        if self._error is not None:
            if isinstance(self._error, MeshslamError):
                raise self._error
            said = f"{type(self._error).__name__}: {self._error}"
            raise SequenceError(f"{self._source}: {said}: the run has stopped") from self._error

    def _stop(self, error: BaseException) -> None:
        """A thread has ended by an error: the others go on, and the next call raises it."""
        with self._news:
            self._error = self._error or error
            self._news.notify_all()

    def _segment(self, frame: _Frame) -> None:
        """The thread of the network."""
        began_s = time.perf_counter()
        try:
            found = self._perception.process(frame.number, frame.image, frame.detections)
        except MeshslamError as error:
            with self._news:
                self.counts.perceptions_failed += 1
                self._notes.append(str(error))
            return
        with self._news:
            self.counts.network_s += time.perf_counter() - began_s
            self.counts.segmented += 1
            self._late[frame.number], self._newest = found, found
            self._notes += self._perception.notes

    def _measure(self, frame: _Frame) -> None:
        """The thread of image features."""
        features = None
        with self._news:
            failed_at, self._failed_at, run = self._failed_at, None, self._run
        if frame.image is not None:
            if self._tracker is None or failed_at is not None:
                self._tracker = FeatureTracker(self._points, failed_at or 0)
            features = self._tracker.measure(frame.image, self._newest)
        self._to_estimate.put(_Measured(frame, features, run))

    def _estimate(self, item: _Measured) -> None:
        """The thread of the window."""
        frame = item.frame
        if item.run != self._run:  # its point tracks go over a frame that failed
            self.counts.skipped += 1
            self._done(frame, None)
            return
        self._imu.wait_for(frame.time_s, self._live.imu_wait_s)
        samples = self._new_samples(frame.time_s)
        with self._news:
            seen = {number: found for number, found in self._late.items() if number <= frame.number}
        own = seen.pop(frame.number, None)
        began_s, was_started = time.perf_counter(), self.is_started
        try:
            with self._lock:
                held = {number: found for number, found in seen.items() if self._slam.holds(number)}
                state = self._slam.process_live(
                    StreamFrame(frame.number, frame.time_s, own), samples, item.features, held
                )
                prediction = self._slam.prediction
        except MeshslamError as error:
            self._failed(frame, error)
            return
        self._given_s = float(samples.times_s[-1]) if len(samples.times_s) else self._given_s
        with self._news:
            taken = (*seen, frame.number) if own is not None else (*seen,)  # its own may have come meanwhile: they wait
            for number in taken:
                self._late.pop(number, None)
            self.counts.too_late += len(seen) - len(held)
            self.counts.taken_in += 1
            took_s = time.perf_counter() - began_s
            if was_started:
                self.counts.window_s += took_s
            elif state.is_started:
                self.counts.start_work_s = took_s
                self.counts.start_drive_s = frame.time_s - self._frames[0][1]
            self._prediction = prediction
        self._done(frame, state)

    def _new_samples(self, time_s: float) -> ImuSamples:
        """Those that the window has not taken in; if all are on another clock, a few that tell so."""
        samples = self._imu.between(self._given_s, time_s + _STALE_S)
        newest = self._imu.newest(3)
        far = len(newest.times_s) > 0 and abs(float(newest.times_s[-1]) - time_s) > _STALE_S
        return newest if far and not len(samples.times_s) else samples

    def _failed(self, frame: _Frame, error: MeshslamError) -> None:
        with self._news:
            self.counts.failed += 1
            self._run += 1
            if self.is_started:
                self._notes.append(str(error))
            else:  # with what comes from here on
                self._notes.append(f"{error}; the search of a start begins anew")
                self.counts.starts_failed += 1
                self._slam, self._given_s = self._fresh(), frame.time_s
            self._failed_at = self._slam.next_index
        self._done(frame, None)

    def _done(self, frame: _Frame, state: SlamState | None) -> None:
        with self._news:
            self._pending -= 1
            self._states[frame.number] = state
            self._news.notify_all()

    def _tell(self, frame: _Frame) -> None:
        """The thread of the poses."""
        until_s = frame.arrived_s + self._live.deadline_s
        with self._news:
            if frame.is_taken:
                left_s = max(0.0, until_s - time.perf_counter())
                self._news.wait_for(lambda: frame.number in self._states or self._error is not None, left_s)
            state = self._states.get(frame.number)
            self._states = {number: one for number, one in self._states.items() if number > frame.number}
            prediction, notes = self._prediction, tuple(self._notes)
            self._notes = []
        pose = self._posed(frame, state, prediction, notes)
        counts = self.counts
        if pose.by == WAITING:
            counts.waiting += 1
        else:
            counts.latencies_s.append(pose.latency_s)
            counts.by_window += pose.by == WINDOW
            counts.by_imu += pose.by == IMU
        if self._on_pose is not None:
            self._on_pose(pose)

    def _posed(
        self,
        frame: _Frame,
        state: SlamState | None,
        prediction: tuple[CameraPrediction, Pose] | None,
        notes: tuple[str, ...],
    ) -> LivePose:
        def since_s() -> float:
            return time.perf_counter() - frame.arrived_s

        number, time_s = frame.number, frame.time_s
        if state is not None and state.is_started:
            notes = (*state.notes, *notes)
            seen = (state.world_from_camera, state.camera_covariance, state.velocity_in_world)
            return LivePose(number, time_s, *seen, since_s(), WINDOW, state.objects, notes, state.world_from_odometry)
        if prediction is None:
            return LivePose(number, time_s, None, None, None, since_s(), WAITING, (), notes)
        newest, map_from_odometry = prediction
        imu = self._imu.between(newest.state.time_s - _BEFORE_S, time_s + _BEFORE_S)
        found = newest.at(imu, time_s, self._imu_config)
        if found.has_gap:
            notes = (*notes, f"frame {number}: IMU samples are missing: its pose says little")
        pose, velocity = (
            map_from_odometry @ found.world_from_camera,
            map_from_odometry.rotation @ found.velocity_in_world,
        )
        return LivePose(number, time_s, pose, found.covariance, velocity, since_s(), IMU, (), notes, map_from_odometry)


def _for_live(given: SlamSettings, live: LiveConfig) -> SlamParts:
    """Settings with what is done otherwise when the camera does not wait."""
    start = given.estimation.unknown_start
    start = replace(start, settling_s=min(start.settling_s, live.start_s))
    return SlamParts(
        given.slam,
        replace(given.estimation, unknown_start=start),
        given.objects,
        given.mapping,
        replace(given.segmentation, zoom=live.zoom),
        replace(given.keypoints, threads=live.network_threads),
        given.tracking,
    )
