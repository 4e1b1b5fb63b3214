"""The front door's functions: a recording in, results in memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from collections.abc import Sequence as Rows
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from meshslam.errors import MapError, SequenceError
from meshslam.evaluation import evaluate_run
from meshslam.maps import Map, TiledMap, Trajectory, TrajectoryEstimate
from meshslam.merging import Merged
from meshslam.object_slam import SlamResult
from meshslam.perception import DetectionSet, our_names
from meshslam.runs import stages
from meshslam.runs.clock import Clock
from meshslam.runs.commands import RECORDING
from meshslam.runs.config import Config, InputConfig
from meshslam.runs.localize_run import localize_recording
from meshslam.runs.map_run import MapResult, map_recording
from meshslam.runs.merge_run import merge_runs
from meshslam.runs.opening import open_input
from meshslam.runs.outlet import Outlet
from meshslam.runs.slam_run import slam_recording
from meshslam.sequences import Sequence
from meshslam.viewing import RunLog

Progress = Callable[[str, int, int], None]
Drive = str | Path | Sequence


@dataclass(frozen=True, eq=False)
class LocalizeResult:
    """The camera's trajectory in a map, and what was used for it."""

    trajectory: Trajectory  # world_from_camera of each frame, in the map's world
    inertial: Trajectory  # by the IMU alone, from the same start
    detections: DetectionSet  # everything that was detected, with the map's ids as tracks
    moved: dict[int, int]  # objects that were found moved, with the frame that showed it
    figures: dict[str, float]  # named as in metrics.json
    notes: tuple[str, ...]  # what the user should know, a sentence each
    estimate: TrajectoryEstimate | None = None  # the trajectory with its uncertainty; None by the gradient solver


def map_drive(
    drive: Drive,
    *,
    segmenter: str | Path | None = None,
    adapter: str | Path | None = None,
    classes: Mapping[str, str] | None = None,
    detections: str | Path | None = None,
    keypoints: bool | None = None,
    category: str | None = None,
    config: Config | None = None,
    progress: Progress | None = None,
    log: RunLog | None = None,
) -> MapResult:
    """Map a recording with known camera poses: every parked object with its pose and its own mesh.

    `drive` is a recording's folder, or what `open_sequence` gives. `segmenter` is a network's file (ONNX), its name in
    the store, or `colour` for a simulated world; without it the recording's own detections are used, or `detections`,
    a file (COCO JSON). `adapter` is a file (YAML) that says how the network is fed and read. `classes` are classes
    that are others of ours: {"vehicle": "car"}. `keypoints` switches the network of key points on or off. `category`
    is a shipped category's name or a category's file (.npz). All of these take the place of the configuration's.
    `progress` is called with a step's name, how many are done, and of how many. `log` is told frames and objects while
    they are computed: see `meshslam.viewing.open_run_log`; whoever opened it closes it.

    In the result, lengths are in metres; vertices (V, 3) are in each object's frame; a pose covariance (6, 6) is that
    of a right perturbation (translation, rotation), m and rad. SequenceError if the recording is damaged or its poses
    are not known; DetectionError, ModelError or CategoryError if detections, network or category cannot be used.

    Example:
        result = meshslam.map_drive("2011_09_26_drive_0048_sync", segmenter="yolov5n-seg.onnx")
        for number, car in result.map.items():
            print(number, car.world_from_object.translation, car.dimensions)  # (3,), (3,), metres
        result.map.save("run")

    """
    clock = Clock()
    seen = _Seen(segmenter, adapter, classes, detections, keypoints)
    recording, settings, outlet = _opened(drive, seen, category, config, progress, log, use_imu=False)
    return map_recording(recording, settings, outlet, clock=clock).result(recording.with_poses_only(), outlet)


def localize(
    drive: Drive,
    map: Map | TiledMap | str | Path,
    *,
    segmenter: str | Path | None = None,
    adapter: str | Path | None = None,
    classes: Mapping[str, str] | None = None,
    detections: str | Path | None = None,
    keypoints: bool | None = None,
    config: Config | None = None,
    progress: Progress | None = None,
    log: RunLog | None = None,
) -> LocalizeResult:
    """Find the camera of every frame in a map of meshes, by IMU, masks and key points; poses are not needed.

    `map` is a Map, a TiledMap, a run's folder, its map.json, an objects.json, or the folder of a map in tiles.
    Everything else is as for `map_drive`; the recording needs an IMU of 50 Hz or more. The result is in the map's
    world: metres, seconds. MapError if the map cannot be read; SequenceError if the recording is damaged, has no IMU,
    or does not show where it starts in the map; DetectionError or ModelError if detections or network cannot be used.

    Example:
        path = meshslam.localize("drive2", "run1", segmenter="yolov5n-seg.onnx").trajectory
        path.positions_in_world  # (n, 3), metres

    """
    clock = Clock()
    seen = _Seen(segmenter, adapter, classes, detections, keypoints)
    recording, settings, outlet = _opened(drive, seen, None, config, progress, log)
    scene = map if isinstance(map, Map | TiledMap) else Map.open(Path(map), allow_outside=settings.input.allow_outside)
    found = localize_recording(recording, scene, settings, outlet, clock)
    path, inertial = (Trajectory(recording.times_s, p) for p in (found.world_from_camera, found.inertial))
    figures = stages.run_figures(found.figures, len(recording), clock)
    figures |= {} if found.estimate is None else found.estimate.figures
    notes = tuple(outlet.notes)
    return LocalizeResult(path, inertial, found.detections, found.moved, figures, notes, found.estimate)


def slam(
    drive: Drive,
    *,
    segmenter: str | Path | None = None,
    adapter: str | Path | None = None,
    classes: Mapping[str, str] | None = None,
    detections: str | Path | None = None,
    keypoints: bool | None = None,
    category: str | None = None,
    config: Config | None = None,
    progress: Progress | None = None,
    log: RunLog | None = None,
) -> SlamResult:
    """Find camera path and objects together, from detections and IMU, or from images alone; poses are not needed.

    Arguments and units are as for `map_drive`. For frames as they come there is `Slam`, which this function feeds.
    SequenceError if the recording is damaged, or if nothing tells how the camera moves: neither an IMU nor images;
    DetectionError, ModelError or CategoryError if detections, network or category cannot be used.

    Example:
        result = meshslam.slam("drive", segmenter="yolov5n-seg.onnx")
        result.map[3].vertices_in_world  # (V, 3), metres
        result.trajectory.positions_in_world  # (n, 3), metres

    """
    clock = Clock()
    seen = _Seen(segmenter, adapter, classes, detections, keypoints)
    recording, settings, outlet = _opened(drive, seen, category, config, progress, log)
    result = slam_recording(recording, settings, outlet, clock)
    own = stages.figures(recording, result.mapping, clock)
    own |= {} if result.estimate is None else result.estimate.figures
    return replace(result, figures=own | result.figures, notes=tuple(outlet.notes))


def merge(
    runs: Rows[str | Path],
    *,
    poses: Literal["constellations", "global"] | None = None,
    config: Config | None = None,
    progress: Progress | None = None,
) -> Merged:
    """Lay the drives of several runs into one world, and make the cars that they share one.

    `runs` are run directories; drives are taken in the order of their times, or as given where these overlap. `poses`
    is "global" where the runs' worlds are one already; by default each is found by the cars that drives share; it takes
    the place of the configuration's. Lengths are metres; the world is that of the first drive. MapError, DetectionError
    or SequenceError for a run that is not there or damaged, or if there are fewer than two.

    Example:
        merged = meshslam.merge(["monday", "tuesday"])
        merged.map.save("city")
        merged.trajectories["tuesday"].positions_in_world  # (n, 3), metres

    """
    settings = config or Config()
    if poses is not None:
        settings = replace(settings, merging=replace(settings.merging, poses=poses))
    outlet = Outlet() if progress is None else Outlet(progress)
    return merge_runs([Path(run) for run in runs], settings, outlet, allow_outside=settings.input.allow_outside)


def evaluate(run: str | Path, truth: str | Path) -> dict[str, float]:
    """Compare a run directory with the truth of a recording: the figures that metrics.json names, with their units.

    `truth` is the recording's folder, with groundtruth.tum, objects.json, association.json; what is not there is not
    compared, and without any of them there are no figures. `run` holds trajectory.tum, map.json or both. MapError if
    there is no such run, or if it is damaged; MapError or SequenceError if the truth is.

    Example:
        print(meshslam.evaluate("run", "drive")["ate_rmse_m"])

    """
    run, truth = Path(run), Path(truth)
    if not (run / "map.json").is_file() and not (run / "trajectory.tum").is_file():
        raise MapError(f"{run}: no run: expected a folder with map.json, trajectory.tum or both")
    if not truth.is_dir():
        raise SequenceError(f"{truth}: no such folder")
    return evaluate_run(truth, run)


@dataclass(frozen=True)
class _Seen:
    """What a caller chooses of how objects are seen; None is the configuration's."""

    segmenter: str | Path | None
    adapter: str | Path | None
    classes: Mapping[str, str] | None
    detections: str | Path | None
    keypoints: bool | None

    def over(self, chosen: InputConfig) -> InputConfig:
        """The settings of the input with these over them."""
        files = {"segmenter": self.segmenter, "adapter": self.adapter, "detections": self.detections}
        values: dict[str, Any] = {name: str(value) for name, value in files.items() if value is not None}
        if self.classes is not None:
            values["category_names"] = tuple(f"{a}={b}" for a, b in our_names(self.classes).items())
        return replace(chosen, **values)


def _opened(
    drive: Drive,
    seen: _Seen,
    category: str | None,
    config: Config | None,
    progress: Progress | None,
    log: RunLog | None,
    *,
    use_imu: bool = True,
) -> tuple[Sequence, Config, Outlet]:
    settings = config or Config()
    chosen = seen.over(settings.input)
    if category is not None:
        chosen = replace(chosen, category=category)
    if seen.keypoints is not None:
        settings = replace(settings, keypoints=replace(settings.keypoints, enabled=seen.keypoints))
    outlet = Outlet(log=log) if progress is None else Outlet(progress, log=log)
    if isinstance(drive, Sequence):
        recording = drive if chosen.detections is None else _with_detections(drive, Path(chosen.detections))
        _note_unused(chosen, outlet)
    else:
        recording = open_input(replace(chosen, sequence=str(drive)), use_imu=use_imu)
    return recording, replace(settings, input=chosen), outlet


def _note_unused(chosen: InputConfig, outlet: Outlet) -> None:
    """Say which settings choose a part of a recording, or files for it, that is open already."""
    names = [path.removeprefix("input.") for path in RECORDING if path != "input.sequence"]
    given = [name for name in names if getattr(chosen, name) != getattr(InputConfig(), name)]
    if given:
        outlet.note(f"input.{given[0]} is not used, as the recording is open already: give it to open_sequence")


def _with_detections(drive: Sequence, path: Path) -> Sequence:
    if not path.is_file():
        raise SequenceError(f"{path}: no such detection file")
    return replace(drive, detections_path=path)
