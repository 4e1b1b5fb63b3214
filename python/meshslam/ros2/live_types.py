"""What the node asks of an estimation that runs beside it: `meshslam.live.LiveSlam`, or `NewestFrame`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from meshslam.geometry import Bytes
from meshslam.maps import Map
from meshslam.sequences import ImuSamples


class LiveEstimator(Protocol):
    """Frames and samples in, from any thread, without waiting; a `LivePose` a frame comes from a thread of its own."""

    @property
    def counts(self) -> Any:  # noqa: ANN401 # a dataclass
        """What became of the frames."""

    def add_imu(self, samples: ImuSamples) -> None:
        """Take samples; MeshslamError if the estimation has stopped."""

    def add_frame(self, image: Bytes, time_s: float, frame: int | None = None) -> None:
        """Take an undistorted image, BGR (h, w, 3); MeshslamError if the estimation has stopped."""

    def map(self) -> Map:
        """The objects as they are now."""

    def finish(self) -> Any:  # noqa: ANN401 # a SlamResult, or nothing
        """Take in what waits, smooth and fit once more."""

    def close(self) -> None:
        """End the threads."""


OnPose = Callable[[Any], None]  # is given each frame's LivePose
