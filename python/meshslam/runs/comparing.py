"""What `compare` shows: finished runs side by side, their cars matched by place, the same frames drawn by each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.errors import MapError, MeshslamError
from meshslam.evaluation import TIME_TOLERANCE_S, match_objects, pair_paths, positions, umeyama
from meshslam.files import must_exist
from meshslam.geometry import Bytes, Camera, Floats, Pose, voxel_iou
from meshslam.maps import Map, MapObject, Trajectory, read_figures
from meshslam.perception import Detection, DetectionSet, read_detections
from meshslam.runs.evaluating import recording_of
from meshslam.runs.opening import open_input
from meshslam.runs.settings import read_yaml
from meshslam.sequences import Progress, Report, no_progress, read_camera_file
from meshslam.sequences import Sequence as Recording
from meshslam.viewing import CarPair, ComparedCars, ComparedRun, Comparison, OverlayFrame, draw_overlay

FRAMES = 6  # drawn at most
WIDEST_PX = 1242


@dataclass(frozen=True, eq=False)
class _Loaded:
    """A run's files, as far as they are there."""

    folder: Path
    run: ComparedRun
    path: Trajectory | None
    drawn_map: Map | None  # its own, or the one that it was given
    detections: DetectionSet | None
    camera: Camera | None
    recording: str | None  # what it read


def compare_runs(
    folders: Sequence[Path],
    *,
    more_figures: Sequence[Mapping[str, float]] = (),
    align: bool = False,
    allow_outside: bool = False,
    progress: Progress = no_progress,
) -> Comparison:
    """Compare runs with the first of them; with `align`, each path and map is laid on the first by the paths (SE(3)).

    `more_figures`, one mapping a run, stand beside those of metrics.json. MapError, SequenceError or DetectionError,
    naming the file, for a run that is not there or damaged.
    """
    if len(folders) < 2:
        raise MapError(f"{len(folders)} run: a comparison needs two runs or more")
    names = _names(folders)
    loaded = [_load(folder, name, allow_outside=allow_outside) for folder, name in zip(folders, names, strict=True)]
    more = more_figures or [{}] * len(folders)
    loaded = [replace(o, run=replace(o.run, figures={**o.run.figures, **m})) for o, m in zip(loaded, more, strict=True)]
    notes = _notes(loaded)
    if align:
        loaded = [loaded[0], *(_aligned(loaded[0], other, notes) for other in loaded[1:])]
    first, cars, distances = loaded[0], [], []
    for done, other in enumerate(loaded[1:], 1):
        cars.append(compare_cars(first.run.map, other.run.map))
        distances.append(_distances(first.path, other.path))
        progress("cars", done, len(loaded) - 1)
    frames = _frames(loaded, notes, progress)
    return Comparison(tuple(o.run for o in loaded), tuple(cars), tuple(distances), frames, tuple(notes))


def compare_cars(first: Map, other: Map) -> ComparedCars:
    """Cars of two maps, matched one to one with the least sum of distances, each within 3 m.

    A map without cars, as `localize` makes none, is not compared: nothing is said of the other's cars.
    """
    if not len(first) or not len(other):
        return ComparedCars((), (), ())
    pairs = match_objects(first, other)
    matched = ({a.id for a, _ in pairs}, {b.id for _, b in pairs})
    return ComparedCars(
        tuple(_pair(a, b) for a, b in pairs),
        tuple(number for number in first if number not in matched[0]),
        tuple(number for number in other if number not in matched[1]),
    )


def _pair(first: MapObject, other: MapObject) -> CarPair:
    first_from_other = first.world_from_object.inverse() @ other.world_from_object
    placed = first_from_other.transform(other.vertices)
    return CarPair(
        first.id,
        other.id,
        first_from_other.translation,
        float(np.degrees(first_from_other.yaw_rad)),
        other.dimensions - first.dimensions,
        voxel_iou(first.vertices, first.faces, placed, other.faces),
    )


def _names(folders: Sequence[Path]) -> list[str]:
    """The folders' names, with as many folders above as make them different."""
    parts = [folder.absolute().parts for folder in folders]
    for depth in range(1, max(map(len, parts)) + 1):
        names = ["/".join(part[-depth:]) for part in parts]
        if len(set(names)) == len(names):
            return names
    return [f"{folder} ({k})" for k, folder in enumerate(folders, 1)]


def _load(folder: Path, name: str, *, allow_outside: bool) -> _Loaded:
    must_exist(folder, "run directory", MapError)
    there = {file: (folder / file).is_file() for file in ("map.json", "trajectory.tum", "metrics.json", "camera.yaml")}
    if not any(there.values()):
        raise MapError(f"{folder}: no run: expected a folder with map.json, trajectory.tum or metrics.json")
    path = Trajectory.load(folder / "trajectory.tum") if there["trajectory.tum"] else None
    scene = Map.load(folder, allow_outside=allow_outside) if there["map.json"] else None
    figures = read_figures(folder) if there["metrics.json"] else {}
    figures.pop("notes", None)
    chosen = recording_of(folder)
    detections = folder / "detections.json"
    run = ComparedRun(
        name,
        str(folder),
        np.zeros(0) if path is None else path.times_s,
        () if path is None else path.world_from_camera,
        scene or Map(()),
        figures,
        _settings(folder),
    )
    return _Loaded(
        folder,
        run,
        path,
        scene if scene is not None or chosen is None else _given_map(chosen.map),
        read_detections(detections) if detections.is_file() else None,
        read_camera_file(folder / "camera.yaml", Report()).camera if there["camera.yaml"] else None,
        None if chosen is None else repr((chosen.sequence, chosen.camera, chosen.topics, chosen.scene)),
    )


def _given_map(place: str | None) -> Map | None:
    """The map that a run was given, if it still can be read."""
    try:
        return None if place is None else Map.load(place)
    except MeshslamError:
        return None


def _settings(folder: Path) -> dict[str, object]:
    """The run's settings by their paths; those under `expert` as if they were public."""
    file = folder / "config.yaml"
    if not file.is_file():
        return {}
    document = read_yaml(file)
    tree: dict[str, Any] = dict(document) if isinstance(document, dict) else {}
    expert = tree.pop("expert", None)
    return dict(_flat(tree)) | dict(_flat(expert if isinstance(expert, dict) else {}))


def _flat(tree: Mapping[str, Any], before: str = "") -> list[tuple[str, object]]:
    rows: list[tuple[str, object]] = []
    for key, value in tree.items():
        path = f"{before}{key}"
        rows += _flat(value, f"{path}.") if isinstance(value, dict) else [(path, value)]
    return rows


def _notes(loaded: Sequence[_Loaded]) -> list[str]:
    notes = []
    for other in loaded:
        parts = {
            "map.json": len(other.run.map),
            "trajectory.tum": len(other.run.world_from_camera),
            "metrics.json": len(other.run.figures),
        }
        lacks = [name for name, count in parts.items() if not count]
        if lacks:
            notes.append(f"{other.run.name}: what is not there, or is empty: {', '.join(lacks)}")
    if len({other.recording for other in loaded}) > 1:
        notes.append("the runs are of different recordings, or it is not known which: their frames are not compared")
    return notes


def _aligned(first: _Loaded, other: _Loaded, notes: list[str]) -> _Loaded:
    """A run laid on the first one by the poses of the same times."""
    pair = None if first.path is None or other.path is None else pair_paths(first.path, other.path)
    if pair is None or len(pair) < 3 or other.path is None:
        notes.append(f"{other.run.name} is not laid on {first.run.name}: their paths share no times")
        return other
    moved = umeyama(positions(pair.truth), positions(pair.estimate), with_scale=False).rigid()
    poses = tuple(moved @ pose for pose in other.path.world_from_camera)
    notes.append(f"{other.run.name} is laid on {first.run.name} by their paths")

    def placed(scene: Map) -> Map:
        return Map(tuple(replace(o, world_from_object=moved @ o.world_from_object) for o in scene.objects))

    return replace(
        other,
        run=replace(other.run, world_from_camera=poses, map=placed(other.run.map)),
        path=Trajectory(other.path.times_s, poses),
        drawn_map=None if other.drawn_map is None else placed(other.drawn_map),
    )


def _distances(first: Trajectory | None, other: Trajectory | None) -> tuple[Floats, Floats]:
    if first is None or other is None:
        return np.zeros(0), np.zeros(0)
    pair = pair_paths(first, other, TIME_TOLERANCE_S)
    away = np.linalg.norm(positions(pair.truth) - positions(pair.estimate), axis=1)
    return pair.times_s - (pair.times_s[0] if len(pair) else 0.0), away


def _frames(loaded: Sequence[_Loaded], notes: list[str], progress: Progress) -> tuple[OverlayFrame, ...]:
    """The same frames, drawn by every run; none where a run does not have all that it takes."""
    if len({other.recording for other in loaded}) > 1:
        return ()
    for other in loaded:
        lacks = [
            name
            for name, part in (
                ("map.json", other.drawn_map),
                ("trajectory.tum", other.path),
                ("detections.json", other.detections),
                ("camera.yaml", other.camera),
            )
            if part is None
        ]
        if lacks:
            notes.append(f"frames are not drawn: {other.run.name} has no {' and no '.join(lacks)}")
            return ()
    poses = [_pose_of_frame(other) for other in loaded]
    shared = sorted(set.intersection(*(set(row) for row in poses)))
    chosen = _chosen(loaded[0], shared)
    if not chosen:
        notes.append("frames are not drawn: the runs share none")
        return ()
    recording = _opened(loaded[0], notes)
    drawn = []
    for done, frame in enumerate(chosen, 1):
        image = _image(recording, frame)
        pictures = tuple(_overlay(other, row[frame], frame, image) for other, row in zip(loaded, poses, strict=True))
        drawn.append(OverlayFrame(frame, pictures))
        progress("frames", done, len(chosen))
    return tuple(drawn)


def _pose_of_frame(loaded: _Loaded) -> dict[int, Pose]:
    """Poses by frame number; MapError if there is not one for each image."""
    if loaded.detections is None or loaded.path is None:
        return {}
    numbers = sorted(image.id for image in loaded.detections.images)
    if len(numbers) != len(loaded.path):
        raise MapError(
            f"{loaded.folder / 'trajectory.tum'}: {len(loaded.path)} poses, but detections.json has {len(numbers)}"
            " images"
        )
    return dict(zip(numbers, loaded.path.world_from_camera, strict=True))


def _chosen(loaded: _Loaded, shared: list[int]) -> list[int]:
    """Of equal parts of the frames, the one that shows mapped objects largest."""
    by_frame = {} if loaded.detections is None else loaded.detections.by_frame()
    mapped = set(loaded.drawn_map or ())

    def shown_px(frame: int) -> float:
        return sum(d.bbox[2] * d.bbox[3] for d in by_frame.get(frame, ()) if d.track_id in mapped)

    parts = np.array_split(np.array(shared, int), min(FRAMES, len(shared)) or 1)
    return [max(part.tolist(), key=shown_px) for part in parts if len(part)]


def _opened(loaded: _Loaded, notes: list[str]) -> Recording | None:
    """The recording that the runs read, if its images are still there."""
    chosen = recording_of(loaded.folder)
    try:
        recording = None if chosen is None else open_input(chosen, use_imu=False)
    except MeshslamError as error:
        notes.append(f"frames are drawn on grey: the recording cannot be opened: {error}")
        return None
    if recording is None or recording.images is None:
        notes.append("frames are drawn on grey: the recording has no images")
        return None
    return recording


def _image(recording: Recording | None, frame: int) -> Bytes | None:
    if recording is None or frame not in recording.frame_ids:
        return None
    return recording.read_image(recording.frame_ids.index(frame))


def _overlay(loaded: _Loaded, world_from_camera: Pose, frame: int, image: Bytes | None) -> Bytes:
    import cv2

    if loaded.camera is None or loaded.detections is None:
        raise MapError(f"{loaded.folder}: has no camera.yaml or no detections.json")
    found: tuple[Detection, ...] = loaded.detections.by_frame().get(frame, ())
    plain = tuple(replace(d, keypoints=None, keypoint_scores=None) for d in found)
    size = (loaded.camera.height, loaded.camera.width)
    fits = image is None or image.shape[:2] == size
    picture = draw_overlay(
        image if fits else None, loaded.camera, world_from_camera, loaded.drawn_map or Map(()), plain
    )
    scale = min(1.0, WIDEST_PX / picture.shape[1])
    if scale == 1.0:
        return picture
    small = (round(picture.shape[1] * scale), round(picture.shape[0] * scale))
    return np.asarray(cv2.resize(picture, small, interpolation=cv2.INTER_AREA), np.uint8)
