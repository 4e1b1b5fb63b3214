"""The configuration of a run."""

from __future__ import annotations

from dataclasses import dataclass, field

from meshslam.features import LengthConfig, RotationConfig
from meshslam.initialization import EstimationConfig
from meshslam.live import LiveConfig
from meshslam.localization import LocalizationConfig
from meshslam.mapping import MappingConfig
from meshslam.merging import MergingConfig
from meshslam.object_slam import SlamConfig
from meshslam.objects import ObjectConfig
from meshslam.perception import ColourConfig, KeypointConfig, SegmenterConfig, TrackerConfig
from meshslam.sequences import Convention
from meshslam.settings import Settings, public


@dataclass(frozen=True)
class InputConfig(Settings):
    """What a run reads."""

    sequence: str = public("", doc="folder or file of the recording")
    layout: str | None = public(None, doc="layout of the recording, where the path does not tell: kitti-raw, folder, …")
    camera: int | None = public(None, low=0, doc="which of the cameras of the layout, or of the extrinsics' file")
    camera_file: str | None = public(None, doc="file with the camera, for recordings that have none")
    size: str | None = public(None, doc="size of the images, 640x480, if the camera's file is of another")
    times: str | None = public(None, doc="file with the times of the frames of a video or folder, one a line, or CSV")
    scene: str | None = public(None, doc="which scene of a data set of several, such as nuScenes")
    rate_hz: float | None = public(None, above=0, doc="frames a second, of a folder of frames without times")
    topics: tuple[str, ...] = public((), doc="topics of a bag: image=/camera/image_raw, camera=, imu=, poses=")
    frames: str | None = public(None, doc="frame numbers FIRST:END:STRIDE, such as 100:600:2")
    from_s: float | None = public(None, low=0, doc="begin so many seconds after the first frame")
    to_s: float | None = public(None, low=0, doc="end so many seconds after the first frame")
    segmenter: str | None = public(None, doc="ONNX file, a name in the store of models, or colour")
    adapter: str | None = public(None, doc="YAML file that says how the segmenter's network is fed and read")
    detections: str | None = public(None, doc="detections (COCO JSON) instead of the recording's own")
    category_names: tuple[str, ...] = public(
        (), doc="classes of detections or network that are others of ours: vehicle=car"
    )
    category: str = public("car", doc="category to map: a shipped one, or a file (.npz)")
    map: str | None = public(None, doc="a run, its map.json, or an objects.json")
    allow_outside: bool = public(False, doc="read meshes of the map that are outside its folder")
    imu: str | None = public(None, doc="IMU samples (CSV) instead of the layout's own")
    imu_from_camera: str | None = public(None, doc="extrinsics: 4 x 4 in YAML or JSON, or Kalibr's camchain-imucam")
    imu_time_offset_s: float = public(
        0.0, low=-1e10, high=1e10, doc="by which the IMU's clock is ahead of the camera's"
    )
    poses: str | None = public(None, doc="file of poses (TUM, EuRoC, VINS, KITTI, COLMAP) instead of the layout's own")
    poses_convention: Convention = public("camera", doc="what the poses are: world_from_camera with z up, or another")
    camera_from_body: str | None = public(None, doc="the poses are world_from_body: camera_from_body, 4 x 4")
    poses_time_offset_s: float = public(
        0.0, low=-1e10, high=1e10, doc="by which the poses' clock is ahead of the camera's"
    )
    poses_scale: float = public(1.0, above=0, doc="metres of one unit of the poses: positions are multiplied by it")


@dataclass(frozen=True)
class Config(Settings):
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
    lengths: LengthConfig = field(default_factory=LengthConfig)
    objects: ObjectConfig = field(default_factory=ObjectConfig)
    mapping: MappingConfig = field(default_factory=MappingConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    localization: LocalizationConfig = field(default_factory=LocalizationConfig)
    slam: SlamConfig = field(default_factory=SlamConfig)
    live: LiveConfig = field(default_factory=LiveConfig)
    merging: MergingConfig = field(default_factory=MergingConfig)
