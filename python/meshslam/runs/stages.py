"""The stages of a run beside perception: open, place the camera, save, count; files are whole or not there."""

from __future__ import annotations

import json
from collections.abc import Iterator
from collections.abc import Sequence as Rows
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from meshslam.categories import Category
from meshslam.errors import SequenceError
from meshslam.evaluation import truth_digest
from meshslam.features import LogFactor, correct_lengths, correct_rotations
from meshslam.files import LOCK, locked, remove_leftovers
from meshslam.geometry import Pose
from meshslam.mapping import ObjectMapping, size_of_cars
from meshslam.maps import INDEX, CameraPath, Map, RunDirectory, Trajectory, TrajectoryEstimate, read_figures, to_glb
from meshslam.perception import DetectionSet, write_detections
from meshslam.runs.clock import Clock
from meshslam.runs.config import Config
from meshslam.runs.inputs import input_digests
from meshslam.runs.memory import give_back_memory
from meshslam.runs.opening import open_input
from meshslam.runs.outlet import Outlet
from meshslam.runs.settings import to_yaml
from meshslam.sequences import Sequence, camera_yaml

_KEPT_IMAGES_BYTES = 64 * 1024**2


@dataclass(frozen=True, eq=False)
class Begun:
    """A run's recording and its folder, which no other process writes meanwhile."""

    recording: Sequence
    run: RunDirectory
    figures: dict[str, float] | None  # of the run, if it is there whole already


@contextmanager
def begin(command: str, settings: Config, out: Path, outlet: Outlet, *, overwrite: bool) -> Iterator[Begun]:
    """Open recording and run directory for the block; MapError if another run, or another process, has the folder."""
    kept = out / INDEX
    recording = open_input(settings.input, use_imu=command != "map", kept_index=kept, progress=outlet.progress)
    recording = recording.with_kept_images(_KEPT_IMAGES_BYTES)
    inputs = input_digests(command, recording, settings)
    RunDirectory.claim(out)
    with locked(out / LOCK, str(out)):
        run = RunDirectory.start(
            out, to_yaml(settings, command), version("meshslam"), inputs=inputs, overwrite=overwrite
        )
        try:
            if recording.index is not None:
                recording.index.save(kept)
            yield Begun(recording, run, _figures_there(recording, run, outlet) if run.is_complete else None)
        finally:
            remove_leftovers(out)


def _figures_there(recording: Sequence, run: RunDirectory, outlet: Outlet) -> dict[str, float]:
    """The figures of a run that is complete; its notes are told again."""
    run.refuse_other_truth(truth_digest(recording.root))
    figures = read_figures(run.folder)
    for note in figures.pop("notes", []):
        outlet.note(note)
    outlet.note(f"{run.folder}: the run is complete already, nothing was computed: --overwrite runs it anew")
    return figures


def end(begun: Begun, figures: dict[str, float], outlet: Outlet) -> dict[str, float]:
    """Write the figures with the notes, and say that the run is complete."""
    begun.run.save("metrics.json", metrics_json(figures, outlet.notes))
    begun.run.finish(truth_digest(begun.recording.root))
    return figures


def need_poses(recording: Sequence) -> tuple[Pose, ...]:
    """The known poses; SequenceError where there are none."""
    if recording.world_from_camera is None:
        raise SequenceError(
            f"{recording.root}: mapping needs the camera's poses: --poses FILE, or those of the layout "
            "(docs/recordings.md); without poses `meshslam slam` finds path and objects"
        )
    return recording.world_from_camera


def camera_path(
    recording: Sequence, found: DetectionSet, category: Category, config: Config, outlet: Outlet
) -> CameraPath:
    """The camera at each frame; where there are images, with lengths and rotations that agree with them."""
    frames = CameraPath(
        recording.camera,
        recording.frame_ids,
        recording.times_s,
        need_poses(recording),
        recording.height_above_ground_m,
    )
    if recording.images is None:
        return frames
    read, by_frame = recording.read_image, found.by_frame()
    if config.lengths.enabled:
        sizes = partial(_sizes, found=found, category=category, config=config)
        lengths = correct_lengths(frames, read, by_frame, config.lengths, sizes, outlet.progress)
        for note in lengths.notes:
            outlet.note(note)
        frames = lengths.frames
    return (
        correct_rotations(frames, read, by_frame, config.rotations, outlet.progress)
        if config.rotations.enabled
        else frames
    )


def _sizes(frames: CameraPath, *, found: DetectionSet, category: Category, config: Config) -> LogFactor | None:
    """True over given lengths of a path by the sizes of the cars beside it."""
    told = size_of_cars(frames, found, category, config.objects, config.mapping, most=config.lengths.cars)
    return None if told is None else LogFactor(*told)


def save(recording: Sequence, frames: CameraPath, mapping: ObjectMapping, run: RunDirectory, outlet: Outlet) -> None:
    """Write what was estimated; the figures come last, so that a run with them is complete."""
    give_back_memory()
    trajectory = Trajectory(frames.times_s, frames.world_from_camera)
    camera = camera_yaml(recording.camera, None, recording.imu_from_camera, recording.height_above_ground_m)
    names = ("camera.yaml", "trajectory.tum", "detections.json", "map.glb")
    run.announce(*names, "left_out.json", "report.html", "metrics.json", "map.json", *mapping.map.mesh_files)
    run.save("camera.yaml", camera)
    run.save("trajectory.tum", trajectory.to_tum())
    run.save("detections.json", written(recording, mapping.detections))
    run.save_map(mapping.map, partial(outlet.progress, "save"))
    saved = Map.load(run.folder), Trajectory.load(run.path("trajectory.tum"))  # as rounded on disk: the same bytes
    run.save("map.glb", to_glb(*saved))
    del saved
    give_back_memory()


def save_estimate(estimate: TrajectoryEstimate | None, run: RunDirectory, outlet: Outlet) -> dict[str, float]:
    """Write trajectory.csv, and give the figures of its uncertainty; a note where the solver knows none."""
    if estimate is None:
        outlet.note("trajectory.csv: not written: the solver gradient gives no uncertainty; the solver smoother does")
        return {}
    run.save("trajectory.csv", estimate.to_csv())
    return estimate.figures


def written(recording: Sequence, found: DetectionSet) -> bytes:
    """The detections' file: where the camera has a lens, it says that its pixels are those of the pinhole view."""
    return write_detections(replace(found, undistorted=recording.distortion is not None))


def figures(recording: Sequence, mapping: ObjectMapping, clock: Clock) -> dict[str, float]:
    """The run's own figures, as docs/formats.md names them."""
    tracks = {d.track_id for d in mapping.detections.detections if d.track_id is not None}
    rows: dict[str, float] = {
        "objects_mapped": len(mapping.map.objects),
        "objects_moving": len(mapping.map.moving),
        "tracks": len(tracks),
        "frames": len(recording),
        **mapping.mask_ious,
    }
    return run_figures(rows, len(recording), clock)


def run_figures(rows: dict[str, float], frames: int, clock: Clock) -> dict[str, float]:
    """A run's own figures with its times and memory up to now."""
    rounded = {key: float(np.round(value, 6)) if isinstance(value, float) else value for key, value in rows.items()}
    return rounded | clock.figures(frames)


def metrics_json(rows: dict[str, float], notes: Rows[str] = ()) -> str:
    """The figures as the file's text, and what the user should know under `notes`."""
    document: dict[str, Any] = {**rows, "notes": list(notes)} if notes else dict(rows)
    return json.dumps(document, indent=1, allow_nan=False) + "\n"
