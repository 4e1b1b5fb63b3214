"""The configuration of a run."""

from __future__ import annotations

from dataclasses import dataclass, field

from meshslam.features import RotationConfig
from meshslam.initialization import EstimationConfig
from meshslam.localization import LocalizationConfig
from meshslam.mapping import MappingConfig
from meshslam.object_slam import SlamConfig
from meshslam.objects import ObjectConfig
from meshslam.perception import ColourConfig, KeypointConfig, SegmenterConfig, TrackerConfig


@dataclass(frozen=True)
class InputConfig:
    """What a run reads."""

    sequence: str = ""
    layout: str | None = None
    camera: int | None = None
    segmenter: str | None = None
    detections: str | None = None
    category: str = "car"
    map: str | None = None  # of `localize`
    imu: str | None = None  # CSV instead of the layout's own
    imu_from_camera: str | None = None  # YAML or JSON, Kalibr's too


@dataclass(frozen=True)
class Config:
    """Everything that decides a run's result: defaults, a YAML file over them, then flags; saved with every run.

    Names carry their units, such as `_m` and `_px`. A configuration is not changed, it is copied with other values.

    Example:
        from dataclasses import replace

        config = meshslam.Config()
        config = replace(config, mapping=replace(config.mapping, max_distance_m=30.0))
        meshslam.map_drive("drive", config=config)

    """

    input: InputConfig = field(default_factory=InputConfig)
    segmentation: SegmenterConfig = field(default_factory=SegmenterConfig)
    colour: ColourConfig = field(default_factory=ColourConfig)
    keypoints: KeypointConfig = field(default_factory=KeypointConfig)
    tracking: TrackerConfig = field(default_factory=TrackerConfig)
    rotations: RotationConfig = field(default_factory=RotationConfig)
    objects: ObjectConfig = field(default_factory=ObjectConfig)
    mapping: MappingConfig = field(default_factory=MappingConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    localization: LocalizationConfig = field(default_factory=LocalizationConfig)
    slam: SlamConfig = field(default_factory=SlamConfig)
