"""Settings of one object's estimate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from meshslam.geometry import NoiseModel
from meshslam.settings import Settings, expert, public


@dataclass(frozen=True)
class GradientConfig(Settings):
    """Weights, steps and iterations of the paper's solver, which leaves them open; each step falls to 0 along a cosine.

    Steps are what a gradient of one a radian, a metre (pose) or one a metre at one vertex moves.
    """

    max_views: int = expert(8, low=1)
    min_keypoint_score: float = expert(0.5, low=0, high=1)  # quality q_lt above which key points are collected
    mask_weight: float = expert(1.0, low=0)
    keypoint_weight: float = expert(1e-4, low=0, unit="1/px²")
    curvature_weight: float = expert(1.0, low=0, unit="1/m²")
    pose_iterations: int = expert(100, low=1)
    rotation_step: float = expert(0.002, above=0, unit="rad²")
    position_step: float = expert(0.005, above=0, unit="m²")
    shape_iterations: int = expert(300, low=1)
    vertex_step: float = expert(0.06, above=0, unit="m²")


@dataclass(frozen=True)
class ObjectConfig(Settings):
    """Settings of one object's estimate; lengths in metres, pixels where the name says so."""

    solver: Literal["residuals", "gradient"] = public(
        "residuals", doc="residuals: second order on the outline; gradient: the paper's descent"
    )
    gradient: GradientConfig = field(default_factory=GradientConfig)
    noise: NoiseModel = field(default_factory=NoiseModel)
    # which views of a track are used
    max_views: int = public(16, low=1, doc="observations of an object that are used; time and memory grow with them")
    start_views: int = expert(4, low=1)  # of these, for the search of the start
    min_view_box_px: float = expert(24.0, low=0)
    # masks
    border_step_px: float = expert(6.0, above=0)  # spacing of border points; their errors are correlated over some 25
    edge_margin_px: int = expert(10, low=0)  # a border this near to the image's edge is not the object's own
    occluder_margin_px: int = expert(3, low=0)  # nor one this near to an occluder
    crop_margin: float = expert(0.25, low=0)  # of the box's size, around it
    # key points
    min_keypoint_score: float = expert(0.3, low=0, high=1)
    keypoint_sigma_share: float = expert(0.02, low=0)  # of the box's larger side
    min_keypoint_sigma_px: float = expert(1.5, above=0)
    # the road
    ground_height_sigma_m: float = expert(0.08, above=0)  # where the camera has been
    ground_slope_sigma: float = expert(0.03, low=0)  # more for every metre away from there
    ground_tilt_sigma_rad: float = expert(0.03, above=0)
    # the search of the start
    start_yaws: int = expert(16, low=1)
    start_candidates: int = expert(4, low=1)
    start_overlap: float = expert(0.7, low=0)  # mask IoU of a start from key points that needs no search
    start_margin: float = expert(50.0, low=0)  # cost by which the mean mesh may fit worse than at the best start,
    start_margin_share: float = expert(1.0, low=0)  # and this share of the best more: the noise is not known yet
    # objects that move, and one object seen as two
    max_speed_m_s: float = expert(1.5, low=0)
    max_way_m: float = expert(2.0, low=0)  # at a lower speed, while it is seen
    motion_gain: float = expert(25.0, low=0)  # by which the cost must fall with the motion
    free_form_views: int = expert(3, low=1)  # that free form needs
