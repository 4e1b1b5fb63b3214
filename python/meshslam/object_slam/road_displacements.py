"""Displacements that the road's texture measures, as factors of the graph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.features import ImageFeatures, RoadConfig, road_displacement_m, road_normal
from meshslam.geometry import Camera, Floats, Pose
from meshslam.graph import Smoother

_RECENT, _NEEDED = 5, 3  # of so many attempts so many must have found a displacement: a single peak is chance


@dataclass
class RoadDisplacements:
    """Adds one displacement after the other, as soon as the camera has driven over the road that it looked at.

    A road that has texture shows it in most frames. On one that has none, a shadow's edge or noise agrees with itself
    now and then, at any length.
    """

    camera: Camera
    height_m: float
    config: RoadConfig
    count: int = 0  # displacements that were measured
    next_frame: int = 1
    recent: tuple[bool, ...] = ()  # whether the last attempts found one

    def step(self, smoother: Smoother, image_features: ImageFeatures) -> None:
        """Measure at all frames over whose road the path now goes."""
        frames = smoother.frames
        poses = {f: smoother.estimate(f).world_from_camera for f in frames}
        self.next_frame = max(self.next_frame, frames[0] + 1)
        while self.next_frame <= frames[-1]:
            normal = road_normal([poses[f].translation for f in frames if f >= self.next_frame], self.config)
            if normal is None:
                return
            self._measure(smoother, image_features, poses, normal)
            self.next_frame += 1

    def _measure(
        self, smoother: Smoother, image_features: ImageFeatures, poses: dict[int, Pose], normal: Floats
    ) -> None:
        second = self.next_frame
        eye = poses[second].translation
        far = [
            f for f in poses if f < second and np.linalg.norm(poses[f].translation - eye) >= self.config.min_baseline_m
        ]
        if not far:
            return
        first, here = max(far), image_features.frame_image(second)
        images, cameras = (image_features.frame_image(first).image, here.image), (poses[first], poses[second])
        found_m = road_displacement_m(images, here.free, cameras, normal, self.height_m, self.camera, self.config)
        self.recent = (*self.recent, found_m is not None)[-_RECENT:]
        if found_m is not None and sum(self.recent) >= _NEEDED:
            self.count += 1
            smoother.measurements.add_displacement(first, second, found_m, self.config.sigma_share * found_m)
