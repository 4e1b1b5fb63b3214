"""Detections of frames that are done, while a run is under way: what ends it, they are not made again."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

from meshslam.errors import DetectionError
from meshslam.files import digest_of, write_atomically
from meshslam.maps import FRAMES, RunDirectory
from meshslam.perception import Detection, DetectionSet, read_detections, write_detections
from meshslam.runs.config import Config
from meshslam.runs.inputs import image_digests, network_digests
from meshslam.sequences import Sequence


@dataclass(frozen=True)
class FrameStore:
    """A file a frame, found again by the content of its image, by the networks and by their settings."""

    folder: Path
    names: dict[int, str]  # by frame

    @staticmethod
    def of(run: RunDirectory, recording: Sequence, config: Config) -> FrameStore:
        """The store of a run; OSError if an image or a network cannot be read."""
        made_by = digest_of(
            [
                network_digests(recording, config),
                (config.segmentation, config.keypoints, config.input.category_names, config.tracking.categories),
                (recording.camera, recording.distortion),
                version("meshslam"),
            ]
        )
        images = zip(recording.frame_ids, image_digests(recording), strict=True)
        return FrameStore(run.path(FRAMES), {n: f"{n:06d}-{digest_of([made_by, image])}.json" for n, image in images})

    def load(self, frame: int) -> DetectionSet | None:
        """A frame's detections; None if they are not there, or not whole."""
        path = self.folder / self.names[frame]
        with contextlib.suppress(DetectionError):
            return read_detections(path) if path.is_file() else None
        return None

    def save(self, frame: int, found: DetectionSet) -> None:
        """Keep a frame's detections; MapError if the disk does not take them."""
        self.folder.mkdir(exist_ok=True)
        write_atomically(self.folder / self.names[frame], write_detections(found))


def one_set(frames: list[DetectionSet]) -> DetectionSet:
    """Frames, one or more, that were looked at one by one, their detections numbered through."""
    found: list[Detection] = []
    for part in frames:
        found += [replace(d, id=len(found) + k) for k, d in enumerate(part.detections, 1)]
    return DetectionSet(tuple(i for part in frames for i in part.images), frames[0].categories, tuple(found))
