"""Tracks of a run that is under way: what ends it, the images are not followed again."""

from __future__ import annotations

import contextlib
import json
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from meshslam.files import digest_of, write_atomically
from meshslam.maps import FRAMES, RunDirectory
from meshslam.perception import DetectionSet, write_detections
from meshslam.runs.config import Config
from meshslam.runs.inputs import image_digests, recording_digests
from meshslam.sequences import Sequence

Tracks = dict[int, int | None]  # by detection


@dataclass(frozen=True)
class TrackStore:
    """A file that is found again by what the tracks are made from."""

    path: Path

    @staticmethod
    def of(run: RunDirectory, recording: Sequence, found: DetectionSet, config: Config) -> TrackStore:
        """The store of a run; OSError if an image cannot be read."""
        made_from = [
            recording_digests(recording),
            image_digests(recording),
            write_detections(found),
            config.tracking,
            version("meshslam"),
        ]
        return TrackStore(run.path(FRAMES) / f"tracks-{digest_of(made_from)}.json")

    def load(self) -> Tracks | None:
        """The tracks; None if they are not there, or not whole."""
        with contextlib.suppress(OSError, ValueError, TypeError):
            return {int(number): track for number, track in json.loads(self.path.read_text(encoding="utf-8"))}
        return None

    def save(self, tracks: Tracks) -> None:
        """Keep the tracks; MapError if the disk does not take them."""
        self.path.parent.mkdir(exist_ok=True)
        write_atomically(self.path, json.dumps(list(tracks.items())).encode())
