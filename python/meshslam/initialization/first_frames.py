"""The first frames of a recording or of a stream, before the camera's motion is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Camera, Floats
from meshslam.sequences import Sequence


@dataclass(frozen=True, eq=False)
class FirstFrames:
    """When frames were taken, and by what camera."""

    camera: Camera
    frame_ids: tuple[int, ...]
    times_s: Floats  # (n,), increasing
    height_above_ground_m: float | None
    source: str  # what messages call the recording

    @staticmethod
    def of(sequence: Sequence) -> FirstFrames:
        """The frames of a recording."""
        height = sequence.height_above_ground_m
        return FirstFrames(sequence.camera, sequence.frame_ids, sequence.times_s, height, str(sequence.root))

    def count_within(self, seconds: float) -> int:
        """How many frames the first seconds hold."""
        return int(np.searchsorted(self.times_s, self.times_s[0] + seconds, side="right"))
