"""The stages of a run: perceive, track, map, save, evaluate, report; each leaves its files whole or not at all."""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from meshslam.categories import load_category
from meshslam.cli.config import Config, InputConfig, to_yaml
from meshslam.errors import DetectionError, ModelError, SequenceError
from meshslam.geometry.arrays import Bytes
from meshslam.localization import imu_notes, object_notes
from meshslam.mapping import Frames, Mapping, correct_rotations, map_objects
from meshslam.maps import Map, RunDirectory, Trajectory, to_glb
from meshslam.perception import (
    ColourSegmenter,
    DetectionSet,
    ImageEntry,
    KeypointFinder,
    Segmenter,
    add_keypoints,
    detect,
    load_segmenter,
    read_detections,
    track,
    write_detections,
)
from meshslam.perception.colour import NAME as COLOUR
from meshslam.perception.model_store import find_model
from meshslam.sequences import Sequence, camera_yaml, open_sequence, turns, with_imu

Bars = Callable[[str, int, int], None]


@dataclass
class Clock:
    """Seconds spent in each stage."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def timing(self, stage: str) -> Iterator[None]:
        """Add the block's time to a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start


def open_input(chosen: InputConfig) -> Sequence:
    """Open the recording that a run reads."""
    if not chosen.sequence:
        raise SequenceError("no recording is named: give its folder, or input.sequence in the configuration")
    given = None if chosen.detections is None else Path(chosen.detections)
    found = open_sequence(chosen.sequence, chosen.layout, chosen.camera, given)
    imu, mounted = (None if path is None else Path(path) for path in (chosen.imu, chosen.imu_from_camera))
    return found if imu is None and mounted is None else with_imu(found, imu, mounted)


def begin(settings: Config, out: Path, *, overwrite: bool) -> tuple[Sequence, RunDirectory, dict[str, float] | None]:
    """Open recording and run directory; also the run's figures, if it is there whole already."""
    recording = open_input(settings.input)
    run = RunDirectory.start(out, to_yaml(settings), version("meshslam"), overwrite=overwrite)
    if not (run.has("metrics.json") and run.has("report.html")):
        return recording, run, None
    done: dict[str, float] = json.loads(run.path("metrics.json").read_text())
    return recording, run, done


def segment_frames(recording: Sequence, config: Config, bars: Bars) -> DetectionSet:
    """Segment every frame with the network of the configuration, or by the colours of a simulated world."""
    segmenter = choose_segmenter(recording, config)
    index = {frame: i for i, frame in enumerate(recording.frame_ids)}
    frames = ((frame, recording.read_image(i)) for frame, i in index.items())
    return detect(frames, segmenter, progress=lambda frame: bars("segment", index[frame] + 1, len(index)))


def choose_segmenter(recording: Sequence, config: Config) -> Segmenter:
    """The network of the configuration, or the reader of coded colours."""
    if by_colour(config):
        return ColourSegmenter(config.colour)
    try:
        model = find_model(config.input.segmenter)
    except ModelError as error:
        if config.input.segmenter is not None:
            raise
        raise SequenceError(
            f"{recording.root}: nothing tells where the objects are: there is no detections.json "
            f"(--detections FILE names another), and {error}"
        ) from None
    return load_segmenter(model, config.segmentation)


def by_colour(config: Config) -> bool:
    """Whether colours tell the objects."""
    return config.input.segmenter == COLOUR


def perceive(recording: Sequence, config: Config, run: RunDirectory, bars: Bars) -> tuple[DetectionSet, bool]:
    """Detections of a recording, and whether their tracks were given.

    What a former run that was cut short has segmented is taken from its folder.
    """
    if config.input.segmenter is None and recording.detections_path is not None:
        found = fitted(read_detections(recording.detections_path), recording, recording.detections_path)
        for warning in found.warnings:
            print(f"note: {warning}", file=sys.stderr)
        return with_keypoints(recording, found, config, bars), tracks_given(found, config)
    if run.has("detections.json") and not by_colour(config):
        found = read_detections(run.path("detections.json"))
        return found.with_tracks({d.id: None for d in found.detections}), False
    found = with_keypoints(recording, segment_frames(recording, config, bars), config, bars)
    run.save("detections.json", write_detections(found))
    return found, tracks_given(found, config)


def say_notes(recording: Sequence, found: DetectionSet, config: Config) -> None:
    """Say what a path will suffer from."""
    for note in imu_notes(recording, config.localization.imu) + object_notes(recording, found):
        print(f"note: {note}", file=sys.stderr)


def tracks_given(found: DetectionSet, config: Config) -> bool:
    """Whether every detection that is tracked has its track already."""
    wanted = [d for d in found.detections if d.category in config.tracking.categories]
    return bool(wanted) and all(d.track_id is not None for d in wanted)


def with_keypoints(recording: Sequence, found: DetectionSet, config: Config, bars: Bars) -> DetectionSet:
    """The detections with key points by the shipped network, where there are images and no key points yet."""
    if not config.keypoints.enabled or recording.image_paths is None:
        return found
    index = {frame: i for i, frame in enumerate(recording.frame_ids)}
    return add_keypoints(
        found,
        lambda frame: recording.read_image(index[frame]),
        KeypointFinder(config.keypoints),
        progress=lambda frame: bars("key points", index.get(frame, -1) + 1, len(index)),
    )


def fitted(found: DetectionSet, recording: Sequence, path: Path) -> DetectionSet:
    """The detections with one image a frame; DetectionError for an image of no frame, or of another size."""
    raw = recording.raw_camera
    of_frame = {image.id: image for image in found.images}
    for number, image in of_frame.items():
        if number not in recording.frame_ids:
            frames = f"{recording.frame_ids[0]} to {recording.frame_ids[-1]}"
            raise DetectionError(f"{path}: images id {number}: no frame of that number; frames are {frames}")
        if (image.width, image.height) != (raw.width, raw.height):
            size = f"{image.width}x{image.height}, the camera's is {raw.width}x{raw.height}"
            raise DetectionError(f"{path}: images id {number}: is {size}")
    missing = (ImageEntry(i, f"{i:06d}.png", raw.width, raw.height) for i in recording.frame_ids if i not in of_frame)
    images = sorted((*found.images, *missing), key=lambda image: image.id)
    return replace(found, images=tuple(images))


def follow(recording: Sequence, found: DetectionSet, config: Config, bars: Bars) -> DetectionSet:
    """Give the detections their tracks."""
    index = {frame: i for i, frame in enumerate(recording.frame_ids)}

    def read(frame: int) -> Bytes:
        return recording.read_image(index[frame])

    return track(
        found,
        read if recording.image_paths is not None else None,
        config.tracking,
        turn=turns(recording),
        progress=lambda frame: bars("track", index.get(frame, -1) + 1, len(index)),
    )


def camera_path(recording: Sequence, found: DetectionSet, config: Config, bars: Bars) -> Frames:
    """The camera at each frame; where there are images, with rotations that agree with them."""
    if recording.world_from_camera is None:
        raise SequenceError(
            f"{recording.root}: mapping needs the camera's poses: poses.tum in a sequence folder, "
            "OXTS in KITTI raw, poses/NN.txt in KITTI odometry"
        )
    frames = Frames(
        recording.camera,
        recording.frame_ids,
        recording.times_s,
        recording.world_from_camera,
        recording.height_above_ground_m,
    )
    if recording.image_paths is None or not config.mapping.rotations.enabled:
        return frames
    return correct_rotations(frames, recording.read_image, found.by_frame(), config.mapping.rotations, bars)


def build_map(frames: Frames, found: DetectionSet, config: Config, bars: Bars, *, fixed_tracks: bool) -> Mapping:
    """Estimate every object of the category."""
    category = load_category(config.input.category)
    return map_objects(frames, found, category, config.mapping, fixed_tracks=fixed_tracks, progress=bars)


def save(recording: Sequence, frames: Frames, mapping: Mapping, run: RunDirectory) -> None:
    """Write what was estimated; the figures come last, so that a run with them is complete."""
    trajectory = Trajectory(frames.times_s, frames.world_from_camera)
    camera = camera_yaml(recording.camera, None, recording.imu_from_camera, recording.height_above_ground_m)
    run.save("camera.yaml", camera)
    run.save("trajectory.tum", trajectory.to_tum())
    run.save("detections.json", write_detections(mapping.detections))
    mapping.map.save(run.folder)
    saved = Map.load(run.folder), Trajectory.load(run.path("trajectory.tum"))  # as rounded on disk: the same bytes
    run.save("map.glb", to_glb(*saved))


def figures(recording: Sequence, mapping: Mapping, clock: Clock) -> dict[str, float]:
    """The run's own figures, as FORMATS names them."""
    tracks = {d.track_id for d in mapping.detections.detections if d.track_id is not None}
    rows: dict[str, float] = {
        "objects_mapped": len(mapping.map.objects),
        "tracks": len(tracks),
        "frames": len(recording),
        **mapping.mask_ious,
    }
    return run_figures(rows, len(recording), clock)


def run_figures(rows: dict[str, float], frames: int, clock: Clock) -> dict[str, float]:
    """A run's own figures with its times and memory."""
    total = sum(clock.seconds.values())
    every: dict[str, float] = {
        **rows,
        "seconds_total": total,
        **{f"seconds_{stage}": seconds for stage, seconds in clock.seconds.items()},
        "milliseconds_per_frame": 1e3 * total / max(1, frames),
        "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    return {key: float(np.round(value, 6)) if isinstance(value, float) else value for key, value in every.items()}


def metrics_json(rows: dict[str, float]) -> str:
    """The figures as the file's text."""
    return json.dumps(rows, indent=1, allow_nan=False) + "\n"
