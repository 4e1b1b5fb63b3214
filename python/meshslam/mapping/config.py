"""Which tracks become objects of the map."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MappingConfig:
    """Settings of mapping; lengths in metres, pixels where the name says so."""

    min_views: int = 3  # or as many as the sequence has frames
    min_box_px: float = 36.0  # width of the widest box of a track
    min_mask_iou: float = 0.60  # drawn mesh against masks, mean over the views used
    max_distance_m: float = 45.0
    max_height_over_road_m: float = 0.45  # or four of the road's sigmas
    max_shape_cost: float = 50.0  # half the squared length of z: 10 on average, with 20 modes
    merge_distance_m: float = 1.5  # two objects nearer than this are one
    use_ground: bool = True  # the road below the camera's path holds the objects' wheels
    estimate_noise: bool = True  # the border's sigma and correlation length, from the first fits
    passes: int = 2  # the second knows the others' depth and shape
