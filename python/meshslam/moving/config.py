"""Settings of objects that drive."""

from __future__ import annotations

from dataclasses import dataclass

from meshslam.settings import Settings, expert


@dataclass(frozen=True)
class MovingConfig(Settings):
    """How vehicles drive, and which tracks become moving objects; random walks per root of a second."""

    enabled: bool = expert(True)  # objects that drive are mapped with their paths, else left out
    doubt_gain: float = expert(4.0, low=0)  # a path is tried where a velocity lowers a parked object's cost by more
    doubt_mask_iou: float = expert(0.85, low=0, high=1)  # and where its mean mask IoU is lower
    standing_gain: float = expert(60.0, low=0)  # by which a path must cost less than a parked object to take its place
    standing_mask_iou: float = expert(0.85, low=0, high=1)  # that the path must reach, too,
    standing_mask_iou_step: float = expert(0.1, low=0, high=1)  # unless it exceeds the parked object's by so much
    min_views: int = expert(6, low=3)  # that an object needs
    max_views: int = expert(40, low=3)  # observations of an object that are used; every detection has a pose
    acceleration: float = expert(1.0, above=0, unit="m/s/√s")  # of the speed
    steering: float = expert(0.05, above=0, unit="1/m/√s")  # of the path's curvature
    slip: float = expert(0.1, above=0, unit="m/√s")  # of the rear axle, across its heading
    turning: float = expert(0.02, above=0, unit="rad/√s")  # of the heading, beside what the curvature tells
    speed_sigma_m_s: float = expert(15.0, above=0)
    curvature_sigma: float = expert(0.07, above=0, unit="1/m")
    road_correlation_m: float = expert(10.0, above=0)  # over which errors of the road's height are alike
    min_speed_m_s: float = expert(0.5, low=0)  # mean over the path
    min_speed_sigmas: float = expert(3.0, low=0)  # of the speed where it is most certain
    min_gain: float = expert(25.0, low=0)  # by which the path must cost less than one place
    min_way_m: float = expert(2.0, low=0)  # between first and last place
