"""What localization and SLAM can be told."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from meshslam.geometry import NoiseModel
from meshslam.localization.alignment import AlignmentConfig
from meshslam.localization.point_tracks import PointConfig
from meshslam.localization.revisit import RevisitConfig
from meshslam.localization.road_speed import RoadConfig


@dataclass(frozen=True)
class ImuConfig:
    """Noise of the IMU and of how it is mounted; densities in continuous time, defaults for KITTI's OXTS RT3003."""

    gyroscope_noise: float = 1e-3  # rad/s/sqrt(Hz)
    accelerometer_noise: float = 2e-2  # m/s2/sqrt(Hz), vibration of the car included
    gyroscope_walk: float = 3e-5  # rad/s2/sqrt(Hz)
    accelerometer_walk: float = 1e-3  # m/s3/sqrt(Hz)
    gyroscope_bias_sigma_rad_s: float = 2e-3  # at the start
    accelerometer_bias_sigma_m_s2: float = 3e-2  # at the start
    gravity_m_s2: float = 9.81  # along -z of the world
    extrinsic_rotation_sigma_deg: float = 0.5  # of imu_from_camera
    time_offset_sigma_s: float = 0.02  # IMU clock minus camera clock
    minimum_rate_hz: float = 50.0
    gap_periods: float = 5.0  # a longer pause between two samples is a gap
    gap_accelerometer_noise: float = 0.7  # m/s2/sqrt(Hz), where samples are missing
    gap_gyroscope_noise: float = 0.05  # rad/s/sqrt(Hz), likewise


@dataclass(frozen=True)
class StartConfig:
    """How well the first state is known."""

    position_sigma_m: float = 0.02
    rotation_sigma_deg: float = 0.1  # roll and pitch
    heading_sigma_deg: float = 0.1
    velocity_sigma_m_s: float = 0.1
    # without initial_state.yaml
    unknown_tilt_sigma_deg: float = 3.0
    unknown_velocity_sigma_m_s: float = 0.5
    unknown_velocity_share: float = 0.12  # and so much of the speed
    settling_s: float = 3.0  # run again and again from the state that they end up with
    settling_rounds: int = 4  # at most


@dataclass(frozen=True)
class SmootherConfig:
    """The window of the fixed-lag smoother."""

    lag_s: float = 2.0
    iterations: int = 2  # a frame
    settled_frames: int = 5  # views so old are held as linear factors


@dataclass(frozen=True)
class AssociationConfig:
    """Which detection shows which mapped object."""

    minimum_iou: float = 0.25  # of the predicted mask with the detection's
    minimum_iou_same_id: float = 0.10  # where the detection's track id is the object's id
    id_bonus: float = 0.10  # added to the overlap there
    largest_distance_m: float = 70.0


@dataclass(frozen=True)
class GateConfig:
    """Which views are believed."""

    largest_cost: float = 2.5  # of a view at the pose that all views agree on, per independent observation
    moved_views: int = 3  # an object whose views are refused so often in a row was moved


@dataclass(frozen=True)
class OdometryConfig:
    """Noise of one frame's step, where there is no IMU."""

    # of known poses that are used as odometry
    translation_sigma_m: float = 0.005
    translation_sigma_share: float = 0.02  # of the step
    rotation_sigma_deg: float = 0.05
    # of motion that goes on evenly, where images alone tell
    acceleration_m_s2: float = 1.5
    turning_rad_s2: float = 1.0


@dataclass(frozen=True)
class SlamConfig:
    """Settings of `slam`, beside those of localization and mapping."""

    poses: Literal["none", "odometry"] = "none"  # how known poses are used, beyond the first
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    start_views: int = 5  # a track becomes an object with so many views
    start_baseline_m: float = 3.0  # and so much way between the first and the last
    start_box_px: float = 40.0  # and so wide a box
    retry_views: int = 4  # after a start that failed
    largest_cost: float = 3.0  # of a view, per independent observation
    minimum_mask_iou: float = 0.6
    motion_views: int = 8  # after so many more of an object, whether it moves is asked again
    nearer: float = 0.7  # an object's height over the road is taken anew where the camera is nearer by this factor
    surface_sigma_m: float = 0.05  # twice mapping's: a car's views share what its surface is off
    size_sigma: float = 1.0  # of what all cars of a place are larger than the category's mean, in its sigmas
    whole_iterations: int = 8  # of the smoothing of the whole path, at the end
    lag_s: float = 4.0
    crop_margin: float = 0.2  # of a box's size, around it: an object in the graph is near where its view expects it
    revisit: RevisitConfig = field(default_factory=RevisitConfig)
    # without a map these are seen in turns only; looser, systematic errors of shapes move them
    time_offset_sigma_s: float = 0.005
    extrinsic_rotation_sigma_deg: float = 0.3
    gyroscope_noise: float = 3e-3  # rad/s/sqrt(Hz); more than in a known map: the camera shakes against the IMU
    points: PointConfig = field(default_factory=PointConfig)  # corners, where there are images
    road: RoadConfig = field(default_factory=RoadConfig)  # its texture as a measure of length


@dataclass(frozen=True)
class LocalizationConfig:
    """Settings of `localize`."""

    solver: Literal["smoother", "gradient"] = "smoother"  # gradient: the paper's, pose by pose
    imu: ImuConfig = field(default_factory=ImuConfig)
    start: StartConfig = field(default_factory=StartConfig)
    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)  # of a start that is not given
    association: AssociationConfig = field(default_factory=AssociationConfig)
    gate: GateConfig = field(default_factory=GateConfig)
    noise: NoiseModel = field(default_factory=NoiseModel)
    smoother: SmootherConfig = field(default_factory=SmootherConfig)
    edge_margin_px: int = 10  # a border this near to the image's edge is not the object's own
    minimum_box_px: float = 20.0
    keypoint_position_sigma_m: float = 0.02  # of a map's key points
    use_map_covariance: bool = True  # objects with a covariance are estimated along, else they are fixed
    gradient_iterations: int = 20  # of the solver `gradient`, a frame
    joint_gradient_iterations: int = 20  # of the solver `gradient` in SLAM
    gradient_keypoint_weight: float = 0.01  # of a squared residual in sigmas, against a mask's IoU
