"""Settings of the correction of step lengths."""

from __future__ import annotations

from dataclasses import dataclass

from meshslam.settings import Settings, expert


@dataclass(frozen=True)
class LengthConfig(Settings):
    """Known step lengths against images, road and cars; lengths in metres."""

    enabled: bool = expert(True)  # correct given step lengths where images, road and cars contradict them
    points: int = expert(400, low=1)  # corners that are followed from a frame on
    steps: int = expert(40, low=3)  # of a stretch of the path that is judged at once
    min_step_m: float = expert(0.05, above=0)  # the path is cut at shorter ones
    given_share: float = expert(0.005, above=0)  # sigma of a given length: this share of it,
    given_sigma_m: float = expert(0.005, low=0)  # and this
    point_inflation: float = expert(1.5, above=0)  # of the points' sigmas: they are tracked in two rows of blocks
    min_sigmas: float = expert(4.0, above=0)  # by which a length must be wrong
    min_share: float = expert(0.03, above=0, below=1)  # of it, too
    road_share: float = expert(0.03, above=0)  # sigma of the road's answer: the camera's height, the road's slope
    road_baseline_m: float = expert(2.0, above=0)  # between two cameras that see it
    cars: int = expert(8, low=0)  # whose sizes are asked, where points or road contradict the given lengths
