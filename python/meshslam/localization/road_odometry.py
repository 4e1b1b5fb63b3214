"""Ways by the road as factors of the graph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Camera, Pose
from meshslam.geometry.arrays import Floats
from meshslam.localization.pictures import Pictures
from meshslam.localization.road_speed import RoadConfig, road_normal, way_along_road_m
from meshslam.localization.smoother import Smoother


@dataclass
class RoadOdometry:
    """Adds one way after the other, as soon as the camera has come over the road that it looked at."""

    camera: Camera
    height_m: float
    config: RoadConfig
    ways: int = 0  # that the road told
    _next: int = 1

    def step(self, smoother: Smoother, pictures: Pictures) -> None:
        """Measure at all frames over whose road the path now goes."""
        frames = smoother.frames
        poses = {f: smoother.estimate(f).world_from_camera for f in frames}
        self._next = max(self._next, frames[0] + 1)
        while self._next <= frames[-1]:
            normal = road_normal([poses[f].translation for f in frames if f >= self._next], self.config)
            if normal is None:
                return
            self._measure(smoother, pictures, poses, normal)
            self._next += 1

    def _measure(self, smoother: Smoother, pictures: Pictures, poses: dict[int, Pose], normal: Floats) -> None:
        second = self._next
        eye = poses[second].translation
        far = [f for f in poses if f < second and np.linalg.norm(poses[f].translation - eye) >= self.config.baseline_m]
        if not far:
            return
        first, here = max(far), pictures.picture(second)
        images, cameras = (pictures.picture(first).image, here.image), (poses[first], poses[second])
        way_m = way_along_road_m(images, here.free, cameras, normal, self.height_m, self.camera, self.config)
        if way_m is not None:
            self.ways += 1
            smoother.come(first, second, way_m, self.config.sigma_share * way_m)
