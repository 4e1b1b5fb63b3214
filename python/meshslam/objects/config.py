"""Settings of one object's estimate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from meshslam.geometry import NoiseModel


@dataclass(frozen=True)
class GradientConfig:
    """Weights, steps and iterations of the paper's solver, which leaves them open; each step falls to 0 along a cosine.

    Steps are what a gradient of one a radian, a metre (pose) or one a metre at one vertex moves.
    """

    max_views: int = 8
    min_keypoint_score: float = 0.5  # quality q_lt above which key points are collected
    mask_weight: float = 1.0
    keypoint_weight: float = 1e-4  # 1/px^2
    curvature_weight: float = 1.0  # 1/m^2
    pose_iterations: int = 100
    rotation_step: float = 0.002  # rad^2
    position_step: float = 0.005  # m^2
    shape_iterations: int = 300
    vertex_step: float = 0.06  # m^2


@dataclass(frozen=True)
class ObjectConfig:
    """Settings of one object's estimate; lengths in metres, pixels where the name says so."""

    solver: Literal["residuals", "gradient"] = "residuals"  # second order on the outline, or the paper's
    gradient: GradientConfig = field(default_factory=GradientConfig)

    noise: NoiseModel = field(default_factory=NoiseModel)
    # which tracks become objects
    # which views of a track are used
    max_views: int = 16
    start_views: int = 4  # of these, for the search of the start
    min_view_box_px: float = 24.0
    # masks
    border_step_px: float = 6.0  # spacing of border points; their errors are correlated over some 25
    edge_margin_px: int = 10  # a border this near to the image's edge is not the object's own
    occluder_margin_px: int = 3  # nor one this near to an occluder
    crop_margin: float = 0.25  # of the box's size, around it
    # key points
    min_keypoint_score: float = 0.3
    keypoint_sigma_share: float = 0.02  # of the box's larger side
    min_keypoint_sigma_px: float = 1.5
    # the road
    ground_height_sigma_m: float = 0.08  # where the camera has been
    ground_slope_sigma: float = 0.03  # more for every metre away from there
    ground_tilt_sigma_rad: float = 0.03
    # the search of the start
    start_yaws: int = 16
    start_candidates: int = 4
    start_overlap: float = 0.7  # mask IoU of a start from key points that makes the search of headings needless
    start_margin: float = 50.0  # cost by which the mean mesh may fit worse than at the best start,
    start_margin_share: float = 1.0  # and this share of the best more: the noise is not known yet
    # objects that move, and one object seen as two
    max_speed_m_s: float = 1.5
    motion_gain: float = 25.0  # by which the cost must fall with the motion
    free_form_views: int = 3  # that free form needs
