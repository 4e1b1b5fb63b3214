"""Which tracks become objects of the map."""

from __future__ import annotations

from dataclasses import dataclass, field

from meshslam.moving import MovingConfig
from meshslam.settings import Settings, expert, public


@dataclass(frozen=True)
class MappingConfig(Settings):
    """Settings of mapping; lengths in metres, pixels where the name says so."""

    min_views: int = public(3, low=1, doc="observations that a track needs, or as many as the sequence has frames")
    min_box_px: float = public(36.0, low=0, doc="width of the widest box that a track needs")
    min_mask_iou: float = public(0.60, low=0, high=1, doc="overlap of the drawn mesh with the masks, mean over views")
    max_distance_m: float = public(60.0, above=0, doc="objects that were never nearer are left out")
    max_height_over_road_m: float = expert(0.45, low=0)  # or four of the road's sigmas
    max_shape_cost: float = expert(50.0, low=0)  # half the squared length of z: 10 on average, with 20 modes
    merge_distance_m: float = expert(1.5, low=0)  # two objects nearer than this are one
    use_ground: bool = public(True, doc="the road below the camera's path holds the objects' wheels")
    estimate_noise: bool = expert(True)  # the border's sigma and correlation length, from the first fits
    common_shape_sigma: float = expert(0.7, low=0)  # of a drive's mean shape about the category's, in the modes' sigmas
    passes: int = expert(2, low=1)  # the second knows the others' depth and shape
    moving: MovingConfig = field(default_factory=MovingConfig)
