"""The front door's functions: a recording in, results in memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from meshslam.evaluation import evaluate_run
from meshslam.maps import Map, Trajectory
from meshslam.object_slam import SlamResult
from meshslam.perception import DetectionSet
from meshslam.runs import stages
from meshslam.runs.config import Config
from meshslam.runs.localize_run import localize_recording
from meshslam.runs.map_run import MapResult, map_recording
from meshslam.runs.outlet import Outlet
from meshslam.runs.slam_run import slam_recording
from meshslam.sequences import Sequence

Progress = Callable[[str, int, int], None]
Drive = str | Path | Sequence


@dataclass(frozen=True, eq=False)
class LocalizeResult:
    """The camera's path in a map.

    `moved` holds objects that were found moved, with the frame that showed it; `inertial` is the path of the IMU alone.
    """

    trajectory: Trajectory
    inertial: Trajectory
    detections: DetectionSet
    moved: dict[int, int]
    figures: dict[str, float]
    notes: tuple[str, ...]


def map_drive(
    drive: Drive,
    *,
    segmenter: str | Path | None = None,
    category: str | None = None,
    config: Config | None = None,
    progress: Progress | None = None,
) -> MapResult:
    """Map a recording with known camera poses: every parked object with its pose and its own mesh.

    `drive` is a recording's folder, or what `open_sequence` gives. `segmenter` is a network's file or its name in the
    store; without it the recording's own detections are used. `progress` is called with a step's name, how many are
    done, and of how many. SequenceError, DetectionError or ModelError say what is missing or wrong.

    Example:
        result = meshslam.map_drive("2011_09_26_drive_0048_sync", segmenter="yolov5n-seg.onnx")
        for number, car in result.map.items():
            print(number, car.world_from_object.translation, car.dimensions)

    """
    recording, settings, outlet = _opened(drive, segmenter, category, config, progress)
    return map_recording(recording, settings, outlet).result(recording, outlet)


def localize(
    drive: Drive,
    map: Map | str | Path,
    *,
    segmenter: str | Path | None = None,
    config: Config | None = None,
    progress: Progress | None = None,
) -> LocalizeResult:
    """Find the camera of every frame in a map of meshes, by IMU, masks and key points.

    `map` is a Map, a run's folder, its map.json, or an objects.json. Everything else is as for `map_drive`; the
    recording needs an IMU of 50 Hz or more.

    Example:
        path = meshslam.localize("drive2", "run1").trajectory

    """
    recording, settings, outlet = _opened(drive, segmenter, None, config, progress)
    scene, clock = map if isinstance(map, Map) else Map.load(Path(map)), stages.Clock()
    found = localize_recording(recording, scene, settings, outlet, clock)
    path, inertial = (Trajectory(recording.times_s, p) for p in (found.world_from_camera, found.inertial))
    figures = stages.run_figures(found.figures, len(recording), clock)
    return LocalizeResult(path, inertial, found.detections, found.moved, figures, tuple(outlet.notes))


def slam(
    drive: Drive,
    *,
    segmenter: str | Path | None = None,
    category: str | None = None,
    config: Config | None = None,
    progress: Progress | None = None,
) -> SlamResult:
    """Find camera path and objects together, from detections and IMU, or from images alone; poses are not needed.

    Arguments as for `map_drive`. For frames as they come there is `Slam`, which this function feeds.

    Example:
        result = meshslam.slam("drive")
        print(len(result.map), result.trajectory.positions_in_world[-1])

    """
    recording, settings, outlet = _opened(drive, segmenter, category, config, progress)
    clock = stages.Clock()
    result = slam_recording(recording, settings, outlet, clock)
    own = stages.figures(recording, result.mapping, clock)
    return replace(result, figures=own | result.figures, notes=tuple(outlet.notes))


def evaluate(run: str | Path, truth: str | Path) -> dict[str, float]:
    """Compare a run directory with the truth of a recording: the figures that metrics.json names.

    `truth` is the recording's folder, with groundtruth.tum, objects.json, association.json; what is not there is not
    compared.

    Example:
        print(meshslam.evaluate("run", "drive")["ate_rmse_m"])

    """
    return evaluate_run(Path(truth), Path(run))


def _opened(
    drive: Drive,
    segmenter: str | Path | None,
    category: str | None,
    config: Config | None,
    progress: Progress | None,
) -> tuple[Sequence, Config, Outlet]:
    settings = config or Config()
    chosen = settings.input
    if segmenter is not None:
        chosen = replace(chosen, segmenter=str(segmenter))
    if category is not None:
        chosen = replace(chosen, category=category)
    recording = drive if isinstance(drive, Sequence) else stages.open_input(replace(chosen, sequence=str(drive)))
    outlet = Outlet() if progress is None else Outlet(progress)
    return recording, replace(settings, input=chosen), outlet
