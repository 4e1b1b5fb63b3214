"""What `evaluate` measures: a run, or a file with a path, and the truth that it is held against."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from meshslam.errors import ConfigError, MapError, MeshslamError, SequenceError
from meshslam.evaluation import Material, MaterialParts, Options, Truth, absolute_errors_m, pair_paths, read_truth
from meshslam.files import must_exist, real_path
from meshslam.maps import Map, Trajectory, TrajectoryEstimate
from meshslam.perception import DetectionSet, read_detections
from meshslam.runs.config import InputConfig
from meshslam.runs.opening import open_input
from meshslam.runs.settings import overlaid, read_yaml
from meshslam.sequences import PathFile, Sequence, read_path_file

_SAME_M = 1e-6  # of rounding in trajectory.tum


@dataclass(frozen=True)
class Measurable:
    """What the user names."""

    run: Path | None = None
    trajectory: Path | None = None  # a file, in place of a run's
    truth: Path | None = None  # a recording, or files; None: the recording of the run's config.yaml
    times: Path | None = None  # of KITTI's poses
    allow_outside: bool = False  # meshes of the map, and of the true objects, beside their folders


@dataclass
class _Found:
    """What is read, and what is said of it."""

    notes: list[str] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)
    own_poses: bool = False  # the true path is the recording's own


def read_material(given: Measurable, options: Options | None = None) -> tuple[Material, tuple[str, ...]]:
    """Read a run and its truth, as far as there are files, and notes for the user.

    MapError, SequenceError or ConfigError, naming the file, if one of them is damaged, or if nothing is there.
    """
    found = _Found()
    parts, path_file = _read_run(given, found)
    truth, true_file, folder = _read_truth(given, found)
    if path_file is not None and true_file is not None:
        _same_clock(given, path_file, true_file)
        if not true_file.has_times:
            found.notes.append("the files have no times: poses are paired line by line")
    true_detections = None
    if folder is not None and (folder / "detections.json").is_file():
        true_detections = read_detections(folder / "detections.json")
        _say_part(parts.get("detections"), true_detections, found)
    else:
        found.missing[MaterialParts.TRUE_DETECTIONS] = _no_detections(folder)
    material = Material(
        truth,
        given_poses=_given_poses(truth, parts.get("path"), found),
        **parts,
        true_detections=true_detections,
        run_folder=given.run,
        options=options or Options(),
        missing=found.missing,
    )
    return material, tuple(found.notes)


def _read_run(given: Measurable, found: _Found) -> tuple[dict[str, Any], PathFile | None]:
    """Parts of the estimate, and the path as a file has it where one is named."""
    run, parts = given.run, dict[str, Any]()
    if run is None and given.trajectory is None:
        raise MapError("nothing to measure: give a run's folder, or --trajectory FILE")
    if run is not None:
        must_exist(run, "run directory", MapError)
        if not any((run / name).is_file() for name in ("map.json", "trajectory.tum")):
            raise MapError(f"{run}: no run: expected a folder with map.json, trajectory.tum or both")
    where = run or given.trajectory
    for part, what, name in (
        ("map", MaterialParts.MAP, "map.json"),
        ("path", MaterialParts.PATH, "trajectory.tum"),
        ("path_estimate", MaterialParts.ESTIMATE, "trajectory.csv"),
        ("detections", MaterialParts.DETECTIONS, "detections.json"),
    ):
        if run is not None and (run / name).is_file():
            parts[part] = _read(run / name, part, given)
        else:
            found.missing[what] = f"{where} has no {name}" if run is not None else f"--trajectory gives no {what}"
    if given.trajectory is None:
        return parts, None
    file = read_path_file(given.trajectory, given.times)
    found.notes += file.notes
    parts["path"] = Trajectory(file.times_s, file.world_from_camera)
    parts.pop("path_estimate", None)
    found.missing[MaterialParts.ESTIMATE] = f"{given.trajectory} has no covariances"
    return parts, file


def _read(path: Path, part: str, given: Measurable) -> object:
    if part == "map":
        return Map.load(path, allow_outside=given.allow_outside)
    if part == "detections":
        return read_detections(path)
    return Trajectory.load(path) if part == "path" else TrajectoryEstimate.load(path)


def _read_truth(given: Measurable, found: _Found) -> tuple[Truth, PathFile | None, Path | None]:
    """The truth, its path as a file has it, and the recording's folder."""
    chosen = recording_of(given.run)
    place = given.truth
    if place is None:
        if chosen is None:
            raise SequenceError("no truth is named: give --truth, a recording's folder or a file")
        place = Path(chosen.sequence)
        found.notes.append(f"truth: {place}, which the run's config.yaml names")
    must_exist(place, "truth", SequenceError)
    if chosen is not None and place.is_dir() and real_path(chosen.sequence) != real_path(place):
        found.notes.append(f"{given.run}: its config.yaml names another recording, {chosen.sequence}, than {place}")
    if place.is_file() and place.suffix == ".json":
        _say_missing(found, place, "objects.json")
        return Truth(Map.load(place, allow_outside=given.allow_outside), None, None), None, None
    if place.is_file() and place.suffix.lower() in (".tum", ".txt", ".csv"):
        file = read_path_file(place, given.times)
        found.notes += file.notes
        _say_missing(found, place, "groundtruth.tum")
        return Truth(None, None, Trajectory(file.times_s, file.world_from_camera)), file, None
    truth = read_truth(place, allow_outside=given.allow_outside) if place.is_dir() else Truth(None, None, None)
    if truth.path is None:
        truth = replace(truth, path=_recorded_path(place, chosen, truth, found))
    for what, part, name in (
        (MaterialParts.TRUE_OBJECTS, truth.objects, "objects.json"),
        (MaterialParts.ASSOCIATION, truth.object_of_annotation, "association.json"),
    ):
        if part is None:
            found.missing[what] = f"{place} has no {name}"
    return truth, None, place if place.is_dir() else None


def _recorded_path(place: Path, chosen: InputConfig | None, truth: Truth, found: _Found) -> Trajectory | None:
    """The recording's own poses, where it has no others."""
    try:
        recording = _opened(place, chosen)
    except MeshslamError as error:
        if truth.objects is None and truth.object_of_annotation is None:
            raise
        found.missing[MaterialParts.TRUE_PATH] = f"{place} has no groundtruth.tum, and no poses: {error}"
        return None
    if recording.world_from_camera is not None:
        path = Trajectory(recording.times_s, recording.world_from_camera)
    elif recording.partial_poses:
        kept = sorted(recording.partial_poses)
        path = Trajectory(recording.times_s[kept], tuple(recording.partial_poses[i] for i in kept))
    else:
        found.missing[MaterialParts.TRUE_PATH] = f"{place} has no groundtruth.tum and no poses"
        return None
    found.notes.append(f"{place}: has no groundtruth.tum: the recording's own poses are taken as the true ones")
    found.own_poses = True
    return path


def _given_poses(truth: Truth, path: Trajectory | None, found: _Found) -> str | None:
    """Why the path cannot be measured, where the run went along the recording's own poses, as `map` does."""
    if truth.path is None or path is None or not found.own_poses:
        return None
    pair = pair_paths(truth.path, path)
    if not len(pair) or absolute_errors_m(pair).max() > _SAME_M:
        return None
    return "the run took the recording's own poses as given: there is no other truth to its path"


def _opened(place: Path, chosen: InputConfig | None) -> Sequence:
    """The recording with its own poses, not those that a run was given; opened as the run did, if it is the same."""
    if chosen is None or real_path(chosen.sequence) != real_path(place):
        chosen = InputConfig(sequence=str(place))
    own = replace(chosen, poses=None, camera_from_body=None, poses_convention="camera", detections=None)
    return open_input(own, use_imu=False)


def recording_of(run: Path | None) -> InputConfig | None:
    """What a run read, if its config.yaml says it in a way that this version knows."""
    if run is None or not (run / "config.yaml").is_file():
        return None
    document = read_yaml(run / "config.yaml")
    values = document.get("input") if isinstance(document, dict) else None
    try:
        chosen = overlaid(InputConfig(), values, str(run / "config.yaml"))
    except ConfigError:
        return None
    return chosen if chosen.sequence else None


def _same_clock(given: Measurable, estimate: PathFile, truth: PathFile) -> None:
    """SequenceError if poses cannot be paired: by lines they must be as many, and both without times."""
    if estimate.has_times != truth.has_times:
        without = given.trajectory if not estimate.has_times else given.truth
        raise SequenceError(f"{without}: KITTI's poses have no times: give --times FILE with one a line")
    if not truth.has_times and len(truth.times_s) != len(estimate.times_s):
        raise SequenceError(
            f"{given.trajectory}: {len(estimate.times_s)} poses, but {given.truth} has {len(truth.times_s)}: without "
            "times they are paired line by line: give --times FILE"
        )


def _say_missing(found: _Found, place: Path, name: str) -> None:
    rows = (
        (MaterialParts.TRUE_OBJECTS, "objects.json"),
        (MaterialParts.ASSOCIATION, "association.json"),
        (MaterialParts.TRUE_PATH, "groundtruth.tum"),
    )
    found.missing.update({what: f"{place} is no recording with {other}" for what, other in rows if other != name})


def _say_part(seen: DetectionSet | None, whole: DetectionSet, found: _Found) -> None:
    if seen is not None and len(seen.images) < len(whole.images):
        found.notes.append(
            f"the run has {len(seen.images)} of the recording's {len(whole.images)} frames: recall and the overlap of "
            "shapes count true objects of the whole recording; A3DP, AP and tracks those in the run's frames"
        )


def _no_detections(folder: Path | None) -> str:
    return "the truth is no recording with detections.json" if folder is None else f"{folder} has no detections.json"
