"""Settings of merging."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from meshslam.maps import ConstellationConfig
from meshslam.settings import Settings, expert, public


@dataclass(frozen=True)
class VisitConfig(Settings):
    """When a car that a drive did not map was in its view."""

    max_distance_m: float = expert(30.0, above=0)
    min_box_px: float = expert(40.0, above=0)  # width of the car as it would be drawn
    min_inside_share: float = expert(0.8, low=0, high=1)  # of it inside the image,
    min_free_share: float = expert(0.7, low=0, high=1)  # and not hidden
    min_frames: int = expert(4, low=1)  # that must show a car's empty place, before it counts as gone
    step_m: float = expert(0.7, above=0)  # frames so far apart on the path are looked at,
    step_deg: float = expert(3.0, above=0)  # or so turned


@dataclass(frozen=True)
class MergingConfig(Settings):
    """How drives are laid into one world, and their cars become one."""

    poses: Literal["constellations", "global"] = public(
        "constellations", doc="global: the runs' worlds are one already, and are corrected only"
    )
    constellations: ConstellationConfig = field(default_factory=ConstellationConfig)
    visits: VisitConfig = field(default_factory=VisitConfig)
    use_views: bool = public(
        True, doc="cars are fitted once more to their views of all drives, where these are at hand"
    )
    max_views: int = expert(32, low=2)  # of a car in all drives together, in that fit,
    min_views: int = expert(6, low=1)  # but so many of each drive at least
    tilt_sigma_deg: float = expert(0.3, above=0)  # of a drive's vertical
    global_sigma_m: float = expert(1.0, above=0)  # of worlds that are one already, along each axis,
    global_sigma_deg: float = expert(0.5, above=0)  # and about it
    place_sigma_m: float = expert(0.02, low=0)  # of a car in its drive beside its covariance: the path's own error
    heading_sigma_deg: float = expert(0.2, low=0)  # likewise
    unknown_place_sigma_m: float = expert(0.2, above=0)  # of a car without a covariance
    unknown_heading_sigma_deg: float = expert(3.0, above=0)  # likewise
    max_joined_m: float = expert(3.0, low=0)  # two estimates nearer than this may be one car, if its views agree
    moved_sigmas: float = expert(4.0, above=0)  # by which a car must stand elsewhere to have moved
    min_moved_m: float = expert(0.3, low=0)  # and so far
    max_moved_m: float = expert(8.0, above=0)  # a car that went further is another one
    size_ratio: float = expert(0.15, above=0)  # of length, width and height of one car, as logarithm
    max_misfit: float = expert(5.0, above=0)  # median squared gap of shared cars, in variances: more is chance
    bent_share: float = expert(3.0, above=0)  # mean squared residual, in variances, from which a drive is bent
