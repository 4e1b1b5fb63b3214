"""Settings of SLAM."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from meshslam.features import PointConfig, RoadConfig
from meshslam.motion import OdometryConfig
from meshslam.object_slam.loop_closure import LoopClosureConfig


@dataclass(frozen=True)
class SlamConfig:
    """Settings of `slam`, beside those of estimation, objects and mapping."""

    solver: Literal["smoother", "gradient"] = "smoother"  # gradient: the paper's joint problem, by descent
    poses: Literal["none", "odometry"] = "none"  # how known poses are used, beyond the first
    lag_s: float = 4.0
    start_views: int = 5  # a track becomes an object with so many views
    min_baseline_m: float = 3.0  # and so much displacement between the first and the last
    min_box_px: float = 40.0  # and so wide a box
    min_mask_iou: float = 0.6
    retry_views: int = 4  # after a start that failed
    max_cost: float = 3.0  # of an observation, per independent one
    motion_views: int = 8  # after so many more of an object, whether it moves is asked again
    nearer: float = 0.7  # an object's height over the road is taken anew where the camera is nearer by this factor
    surface_sigma_m: float = 0.05  # twice mapping's: a car's views share what its surface is off
    size_sigma: float = 1.0  # of what all cars of a place are larger than the category's mean, in its sigmas
    full_trajectory_iterations: int = 8
    crop_margin: float = 0.2  # of a box's size, around it: an object in the graph is near where its view expects it
    # without a map these are seen in turns only; with larger sigmas, systematic errors of shapes move them
    time_offset_sigma_s: float = 0.005
    extrinsic_rotation_sigma_deg: float = 0.3
    gyroscope_noise: float = 3e-3  # rad/s/sqrt(Hz); more than in a known map: the camera shakes against the IMU
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    loop_closure: LoopClosureConfig = field(default_factory=LoopClosureConfig)
    points: PointConfig = field(default_factory=PointConfig)  # point tracks, where there are images
    road: RoadConfig = field(default_factory=RoadConfig)  # its texture as a measure of length
    refine_map: bool = True  # at the end, fit the objects again along the smoothed path
    gradient_iterations: int = 20  # of the solver `gradient`
    gradient_keypoint_weight: float = 0.01  # likewise, of a squared residual in sigmas, against a mask's IoU
