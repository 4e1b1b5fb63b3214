"""Settings of SLAM."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from meshslam.features import PointConfig, RoadConfig
from meshslam.motion import OdometryConfig
from meshslam.object_slam.loop_closure import LoopClosureConfig
from meshslam.settings import Settings, expert, public


@dataclass(frozen=True)
class SlamConfig(Settings):
    """Settings of `slam`, beside those of estimation, objects and mapping."""

    solver: Literal["smoother", "gradient"] = public("smoother", doc="gradient: the paper's joint problem, by descent")
    poses: Literal["none", "odometry"] = public("none", doc="how known poses are used, beyond the first")
    lag_s: float = public(4.0, above=0, doc="length of the window that is estimated again with every frame")
    start_views: int = expert(5, low=2)  # a track becomes an object with so many views
    min_baseline_m: float = expert(3.0, low=0)  # and so much displacement between the first and the last
    min_box_px: float = expert(40.0, low=0)  # and so wide a box
    min_mask_iou: float = expert(0.6, low=0, high=1)
    retry_views: int = expert(4, low=1)  # after a start that failed
    max_cost: float = expert(3.0, above=0)  # of an observation, per independent one
    motion_views: int = expert(8, low=1)  # after so many more of an object, whether it moves is asked again
    max_shape_error: float = expert(70.0, above=0)  # squared sigmas of an object's modes: beyond, no car has that shape
    nearer: float = expert(0.7, above=0, below=1)  # an object's height over the road is taken anew from so much nearer
    surface_sigma_m: float = expert(0.05, low=0)  # twice mapping's: a car's views share what its surface is off
    size_sigma: float = expert(2.0, above=0)  # of what a place's cars have in common against the mean, in its sigmas
    full_trajectory_iterations: int = expert(8, low=1)
    crop_margin: float = expert(0.2, low=0)  # of a box's size, around it: a view expects an object of the graph near it
    # without a map these are seen in turns only; with larger sigmas, systematic errors of shapes move them
    time_offset_sigma_s: float = expert(0.005, above=0)
    extrinsic_rotation_sigma_deg: float = expert(0.1, above=0)
    # more than in a known map: the camera shakes against the IMU
    gyroscope_noise: float = public(3e-3, above=0, unit="rad/s/√Hz", doc="noise density, instead of estimation.imu's")
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    loop_closure: LoopClosureConfig = field(default_factory=LoopClosureConfig)
    points: PointConfig = field(default_factory=PointConfig)  # point tracks, where there are images
    road: RoadConfig = field(default_factory=RoadConfig)  # its texture as a measure of length
    refine_map: bool = public(True, doc="at the end, fit the objects again along the smoothed path")
    gradient_iterations: int = expert(20, low=0)  # of the solver `gradient`
    gradient_keypoint_weight: float = expert(0.01, low=0)  # likewise, of a squared residual in sigmas
