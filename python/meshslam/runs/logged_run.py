"""What a run tells its log, if it has one: frames as they come, objects as they change, the result at the end."""

from __future__ import annotations

import time
from collections.abc import Mapping
from collections.abc import Sequence as Rows
from dataclasses import dataclass, field
from functools import cached_property, partial

from meshslam.geometry import Bytes, Floats, Pose
from meshslam.maps import Map, MapObject, Trajectory, TrajectoryEstimate
from meshslam.perception import Detection, DetectionSet, read_detections
from meshslam.runs.outlet import Outlet
from meshslam.runs.stages import Begun
from meshslam.sequences import Sequence
from meshslam.viewing import ReportContext, RunLog, log_finished_run


@dataclass
class LoggedRun:
    """A recording on its way through a run; without a log nothing is read or computed for it."""

    recording: Sequence
    log: RunLog | None
    known_path: Rows[Pose] | None = None  # world_from_camera, where it is known before the run
    _last_s: float = field(default_factory=time.perf_counter)

    @cached_property
    def _index(self) -> dict[int, int]:
        """Indices by frame number."""
        return {frame: index for index, frame in enumerate(self.recording.frame_ids)}

    @staticmethod
    def begin(recording: Sequence, outlet: Outlet, known_path: Rows[Pose] | None = None) -> LoggedRun:
        """Begin the log with a recording; `known_path` is its frames' world_from_camera, where it is known before."""
        if outlet.log is not None:
            outlet.log.begin(recording.name, recording.camera)
        return LoggedRun(recording, outlet.log, known_path)

    @property
    def is_on(self) -> bool:
        """Whether there is a log."""
        return self.log is not None

    @property
    def wants_sigmas(self) -> bool:
        """Whether the uncertainty of objects is shown."""
        return self.log is not None and self.log.colouring == "sigma"

    def perceived(self, index: int, found: Rows[Detection], image: Bytes | None) -> None:
        """A frame was segmented."""
        if self.log is not None:
            pose = None if self.known_path is None else self.known_path[index]
            shown = self._image(index) if image is None else image
            self._frame(index, pose, None, shown, found, None, "perception")

    def placed(self, found: DetectionSet, path: Rows[Pose]) -> None:
        """All frames with their tracked detections and their poses."""
        if self.log is not None:
            by_frame = found.by_frame()
            for index, frame in enumerate(self.recording.frame_ids):
                self._frame(index, path[index], None, self._image(index), by_frame.get(frame, ()), None, None)

    def estimated(
        self,
        frame: int,
        pose: Pose | None,
        covariance: Floats | None,
        found: Rows[Detection],
        *,
        image: Bytes | None = None,
        objects: Rows[MapObject] | None = None,
        stage: str,
        milliseconds: float | None = None,
    ) -> None:
        """A frame's pose was estimated; `stage` names what took `milliseconds`, or the time since the last frame."""
        if self.log is not None:
            index = self._index[frame]
            shown = self._image(index) if image is None else image
            self._frame(index, pose, covariance, shown, found, objects, stage, milliseconds)

    def objects(self, objects: Rows[MapObject]) -> None:
        """All objects as they are known now."""
        if self.log is not None:
            self.log.objects(objects)

    def result(
        self,
        scene: Map,
        path: Trajectory,
        found: DetectionSet,
        estimate: TrajectoryEstimate | None = None,
        world_from_live: Pose | None = None,
    ) -> None:
        """What the run ends with."""
        if self.log is not None:
            context = ReportContext(
                title=self.recording.name,
                camera=self.recording.camera,
                frame_ids=self.recording.frame_ids,
                world_from_camera=path.world_from_camera,
                times_s=path.times_s,
                detections=found,
                map=scene,
                read_image=self.recording.read_image if self.recording.images is not None else None,
                covariances=None if estimate is None else estimate.covariances,
            )
            log_finished_run(self.log, context, world_from_live)

    def _image(self, index: int) -> partial[Bytes] | None:
        return None if self.recording.images is None else partial(self.recording.read_image, index)

    def _frame(
        self,
        index: int,
        pose: Pose | None,
        covariance: Floats | None,
        image: Bytes | partial[Bytes] | None,
        found: Rows[Detection],
        objects: Rows[MapObject] | None,
        stage: str | None,
        milliseconds: float | None = None,
    ) -> None:
        assert self.log is not None
        now_s = time.perf_counter()
        took_ms = 1e3 * (now_s - self._last_s) if milliseconds is None else milliseconds
        timings: Mapping[str, float] | None = None if stage is None else {stage: took_ms}
        self._last_s = now_s
        frame, time_s = self.recording.frame_ids[index], float(self.recording.times_s[index])
        self.log.frame(frame, time_s, pose, covariance, image, found, objects, timings)


def log_run_directory(begun: Begun, outlet: Outlet, scene: Map | None = None) -> None:
    """Tell the log of a run that is in its folder already; `scene` is the map that it localized in."""
    if outlet.log is None:
        return
    run, recording = begun.run, begun.recording
    path = Trajectory.load(run.path("trajectory.tum"))
    if len(path) != len(recording):  # a map is of the frames with poses only
        recording = recording.with_poses_only()
    estimate = TrajectoryEstimate.load(run.path("trajectory.csv")) if run.has("trajectory.csv") else None
    logged, found = LoggedRun.begin(recording, outlet), read_detections(run.path("detections.json"))
    logged.result(Map.load(run.folder) if scene is None else scene, path, found, estimate)
