"""SLAM of the first seconds, for localization in a map in which nobody has said where the drive begins."""

from __future__ import annotations

from collections.abc import Mapping

from meshslam.categories import Category
from meshslam.geometry import Camera, Pose
from meshslam.localization import LocalMap
from meshslam.maps import Constellation
from meshslam.object_slam.slam import Slam, SlamSettings
from meshslam.object_slam.start import StreamFrame
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples

_LEAST_VIEWS = 2  # of an object whose place is compared


class SlamLocalMapping:
    """A local map by SLAM: what `localize` and `Localizer` look for in a large map, where no start is given.

    Lengths are metres, times seconds. CategoryError if the category cannot be found; `take` raises what
    `Slam.process` does.

    Example:
        mounted, local_mapping = drive.imu_from_camera, meshslam.object_slam.SlamLocalMapping
        localizer = meshslam.Localizer(drive.camera, city, imu_from_camera=mounted, local_mapping=local_mapping)

    """

    def __init__(
        self,
        camera: Camera,
        imu_from_camera: Pose,
        keypoint_names: Mapping[str, tuple[str, ...]],
        source: str,
        *,
        category: str | Category = "car",
        config: SlamSettings | None = None,
    ) -> None:
        """`keypoint_names` are the order of detections' key points, by category; objects of one category are mapped."""
        name = category if isinstance(category, str) else category.name
        names = keypoint_names.get(name)
        self._slam = Slam(
            camera,
            category=category,
            imu_from_camera=imu_from_camera,
            keypoint_names=names,
            config=config,
            source=source,
        )
        self._has_started, self._frames = False, list[int]()

    def take(self, frame: int, time_s: float, imu: ImuSamples | None, detections: tuple[Detection, ...]) -> None:
        """The next frame: its tracked detections, and the samples that came since the last one."""
        state = self._slam.process_tracked(StreamFrame(frame, time_s, detections), imu=imu)
        self._has_started = state.is_started
        self._frames.append(frame)

    def local_map(self) -> LocalMap | None:
        """The map so far; None before SLAM has started."""
        if not self._has_started:
            return None
        seen = [thing for thing in self._slam.map().objects if thing.views >= _LEAST_VIEWS]
        path = dict(zip(self._frames, self._slam.trajectory().world_from_camera, strict=True))
        return LocalMap(self._slam.first_state, Constellation.of(seen), path)
