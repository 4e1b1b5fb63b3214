"""Detections of a recording: read, or made by networks; and their tracks."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence as Rows
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from meshslam.errors import ConfigError, ModelError, SequenceError
from meshslam.geometry import Bytes
from meshslam.maps import RunDirectory
from meshslam.perception import (
    COLOUR,
    ColourSegmenter,
    Detection,
    DetectionSet,
    KeypointFinder,
    Segmenter,
    add_keypoints,
    detect,
    find_model,
    load_segmenter,
    read_recorded_detections,
    renamings,
    track,
    untracked,
)
from meshslam.runs.config import Config
from meshslam.runs.frame_store import FrameStore, one_set
from meshslam.runs.memory import give_back_memory
from meshslam.runs.outlet import Outlet
from meshslam.runs.track_store import TrackStore
from meshslam.sequences import Sequence, turns

OnFrame = Callable[[int, Rows[Detection], Bytes | None], None]


@dataclass(frozen=True, eq=False)
class Perceived:
    """What frames show."""

    detections: DetectionSet
    has_given_tracks: bool  # every detection that is tracked had its track already


def perceive(
    recording: Sequence,
    config: Config,
    outlet: Outlet,
    run: RunDirectory | None = None,
    on_frame: OnFrame | None = None,
) -> Perceived:
    """Detections of a recording: its own file's, unless a network is named; with key points where there are images.

    What a former run that was cut short has segmented is taken from its folder. `on_frame` is called with each frame
    that a network has looked at: index, detections, and the image if it was read.
    """
    given = given_detections(recording, config)
    if given is not None:
        if config.input.adapter is not None:
            raise ConfigError(
                f"input.adapter: {given} is read, no network: leave the adapter out, or name the network (--segmenter)"
            )
        renamed, tracked = renamings(config.input.category_names), config.tracking.categories
        found = read_recorded_detections(given, recording, renamed, tracked, progress=partial(outlet.progress, "read"))
        for warning in found.warnings:
            outlet.note(warning)
        give_back_memory()
        unused = untracked(found, tracked)
        if unused is not None:
            outlet.note(f"{given}: {unused}")
        return _perceived(with_keypoints(recording, found, config, outlet), config)
    if run is None or by_colour(config):
        found = with_keypoints(recording, segment_frames(recording, config, outlet), config, outlet)
    else:
        found = look_at_frames(recording, config, outlet, FrameStore.of(run, recording, config), on_frame)
    unused = untracked(found, config.tracking.categories)
    if unused is not None:
        outlet.note(unused)
    return _perceived(found, config)


def given_detections(recording: Sequence, config: Config) -> Path | None:
    """The file of detections that is read; None where a network, or colours, tell the objects."""
    return recording.detections_path if config.input.segmenter is None else None


def look_at_frames(
    recording: Sequence, config: Config, outlet: Outlet, store: FrameStore, on_frame: OnFrame | None = None
) -> DetectionSet:
    """Segment every frame and find its key points, those that the store has not; what is done is kept there."""
    segmenter, finder = choose_segmenter(recording, config, outlet), _finder(recording, config)
    found: list[DetectionSet] = []
    for i, frame in enumerate(recording.frame_ids):
        seen, image = store.load(frame), None
        if seen is None:
            image = recording.read_image(i)
            seen = detect([(frame, image)], segmenter)
            seen = seen if finder is None else add_keypoints(seen, lambda _, image=image: image, finder)  # type: ignore[misc]
            store.save(frame, seen)
        found.append(seen)
        outlet.progress("segment", i + 1, len(recording))
        if on_frame is not None:
            on_frame(i, seen.detections, image)
    return one_set(found)


def segment_frames(recording: Sequence, config: Config, outlet: Outlet) -> DetectionSet:
    """Segment every frame with the network of the configuration, or by the colours of a simulated world."""
    segmenter = choose_segmenter(recording, config, outlet)
    index = {frame: i for i, frame in enumerate(recording.frame_ids)}
    frames = ((frame, recording.read_image(i)) for frame, i in index.items())
    return detect(frames, segmenter, progress=lambda frame: outlet.progress("segment", index[frame] + 1, len(index)))


def choose_segmenter(recording: Sequence, config: Config, outlet: Outlet, threads: int = 2) -> Segmenter:
    """The network of the configuration, or the reader of coded colours; what is assumed of a network is said."""
    renamed, adapter = renamings(config.input.category_names), config.input.adapter
    if by_colour(config):
        if renamed or adapter is not None:
            name = "adapter" if adapter is not None else "category_names"
            raise ConfigError(f"input.{name}: coded colours are read without a network: leave it out")
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
    said = None if adapter is None else Path(adapter)
    found = load_segmenter(
        model,
        config.segmentation,
        threads,
        adapter=said,
        renamed=renamed,
        tracked=config.tracking.categories,
    )
    for note in getattr(found, "notes", ()):
        outlet.note(note)
    return found


def by_colour(config: Config) -> bool:
    """Whether colours tell the objects."""
    return config.input.segmenter == COLOUR


def _perceived(found: DetectionSet, config: Config) -> Perceived:
    wanted = [d for d in found.detections if d.category in config.tracking.categories]
    return Perceived(found, bool(wanted) and all(d.track_id is not None for d in wanted))


def with_keypoints(recording: Sequence, found: DetectionSet, config: Config, outlet: Outlet) -> DetectionSet:
    """The detections with key points by the shipped network, where there are images and no key points yet."""
    finder = _finder(recording, config)
    if finder is None:
        return found
    index = {frame: i for i, frame in enumerate(recording.frame_ids)}
    return add_keypoints(
        found,
        lambda frame: recording.read_image(index[frame]),
        finder,
        progress=lambda frame: outlet.progress("key points", index.get(frame, -1) + 1, len(index)),
    )


def _finder(recording: Sequence, config: Config) -> KeypointFinder | None:
    """The key point network, where there are images and it is not switched off."""
    wanted = config.keypoints.enabled and recording.images is not None
    return KeypointFinder(config.keypoints) if wanted else None


def follow(
    recording: Sequence, found: DetectionSet, config: Config, outlet: Outlet, run: RunDirectory | None = None
) -> DetectionSet:
    """Give the detections their tracks; those of a former run that was cut short are taken from its folder."""
    if run is None or recording.images is None:
        return _follow(recording, found, config, outlet)
    store = TrackStore.of(run, recording, found, config)
    known = store.load()
    if known is None:
        known = {d.id: d.track_id for d in _follow(recording, found, config, outlet).detections}
        store.save(known)
    return found.with_tracks(known)


def _follow(recording: Sequence, found: DetectionSet, config: Config, outlet: Outlet) -> DetectionSet:
    index = {frame: i for i, frame in enumerate(recording.frame_ids)}

    def read(frame: int) -> Bytes:
        return recording.read_image(index[frame])

    return track(
        found,
        read if recording.images is not None else None,
        config.tracking,
        turn=turns(recording),
        progress=lambda frame: outlet.progress("track", index.get(frame, -1) + 1, len(index)),
    )
