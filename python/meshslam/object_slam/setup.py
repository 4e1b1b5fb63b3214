"""What a run of SLAM is told once."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

from meshslam.categories import Category
from meshslam.geometry import Camera, NoiseModel, ObjectModel
from meshslam.initialization import EstimationConfig
from meshslam.mapping import MappingConfig
from meshslam.motion import ImuConfig, Mounting
from meshslam.object_slam.config import SlamConfig
from meshslam.objects import ObjectConfig, category_model


@dataclass(frozen=True, eq=False)
class SlamSetup:
    """The camera, the category of the objects, and all settings."""

    camera: Camera
    category: Category
    keypoint_names: tuple[str, ...]  # of the category, in the order of the detections
    mounting: Mounting
    height_above_ground_m: float | None
    slam: SlamConfig = field(default_factory=SlamConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    objects: ObjectConfig = field(default_factory=ObjectConfig)
    mapping: MappingConfig = field(default_factory=MappingConfig)

    @cached_property
    def model(self) -> ObjectModel:
        """The category's observation model."""
        return category_model(self.category)

    @cached_property
    def noise(self) -> NoiseModel:
        """Noise of the observations; the key points' own is set observation by observation."""
        return replace(self.objects.noise, keypoint_position_sigma_m=0.0)

    @property
    def imu(self) -> ImuConfig:
        """The IMU's settings: without a map, clock and mounting are held tighter, and the gyroscope counts less."""
        return replace(
            self.estimation.imu,
            time_offset_sigma_s=self.slam.time_offset_sigma_s,
            extrinsic_rotation_sigma_deg=self.slam.extrinsic_rotation_sigma_deg,
            gyroscope_noise=self.slam.gyroscope_noise,
        )
