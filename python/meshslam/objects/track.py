"""One track: the detections of one object with the cameras that saw them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.categories import Category, keypoint_order
from meshslam.geometry import Bytes, Camera, Floats, ObjectModel, Pose, View
from meshslam.objects.config import ObjectConfig
from meshslam.objects.observations import make_view
from meshslam.perception import Detection


@dataclass(frozen=True, eq=False)
class Track:
    """Detections of one object, by frame, with the cameras that saw them."""

    id: int
    detections: tuple[Detection, ...]
    world_from_camera: tuple[Pose, ...]
    times_s: Floats  # (n,)

    def subset(self, chosen: Sequence[int]) -> Track:
        """Keep the detections with these indices."""
        picked = list(chosen)
        return Track(
            self.id,
            tuple(self.detections[i] for i in picked),
            tuple(self.world_from_camera[i] for i in picked),
            self.times_s[picked],
        )


def is_cut(detection: Detection, camera: Camera, margin_px: float) -> bool:
    """Whether the detection's box touches the left, right or lower edge of the image."""
    x, y, w, h = detection.bbox
    return x < margin_px or x + w > camera.width - margin_px or y + h > camera.height - margin_px


def choose_views(track: Track, count: int, config: ObjectConfig) -> list[int]:
    """Pick `count` detections, spread over the path by how the camera moves against its distance to the object."""
    sizes = np.array([d.bbox[2] * d.bbox[3] for d in track.detections])
    wide = np.array([d.bbox[2] >= config.min_view_box_px for d in track.detections])
    usable = np.flatnonzero(wide) if wide.any() else np.array([int(sizes.argmax())])
    if len(usable) <= count:
        return [int(i) for i in usable]
    centres = np.array([track.world_from_camera[i].translation for i in usable])
    # a step counts as much as it turns the line of sight: in proportion to the size of the box
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    scale = np.sqrt(sizes[usable])
    turned = np.concatenate([[0.0], np.cumsum((steps + 1e-3) * 0.5 * (scale[1:] + scale[:-1]))])
    wanted = np.linspace(0, turned[-1], count)
    nearest = np.abs(turned[:, None] - wanted[None]).argmin(0)
    return [int(usable[i]) for i in sorted(set(nearest.tolist()))]


def make_views(
    track: Track,
    model: ObjectModel,
    category: Category,
    keypoint_names: Sequence[str],
    camera: Camera,
    occluder_of: Callable[[Detection], Bytes],
    config: ObjectConfig,
    chosen: Sequence[int] | None = None,
) -> list[View]:
    """Views of a track's detections, or of the chosen; `occluder_of` draws what stands before a detection's object."""
    order = keypoint_order(keypoint_names, category.keypoint_names)
    times = track.times_s - track.times_s.mean()

    def view(i: int) -> View:
        pose, detection = track.world_from_camera[i], track.detections[i]
        return make_view(model, camera, pose, float(times[i]), detection, occluder_of(detection), order, config)

    return [view(i) for i in (range(len(track.detections)) if chosen is None else chosen)]
