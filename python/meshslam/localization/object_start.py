"""The first estimate of an object that SLAM takes in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshslam.geometry.arrays import Bytes
from meshslam.mapping.reconstruct import Observed, Reconstruction, Scene, motion, reconstruct
from meshslam.mapping.track import Track, make_views


def object_of(
    track: Track, occluders: Sequence[Bytes], scene: Scene, minimum_mask_iou: float
) -> Reconstruction | str | None:
    """The object of a track, `occluders` being what hides it in each view; "moves" if it does, None if it fits none."""
    config = scene.config
    hidden = {d.id: occluder for d, occluder in zip(track.detections, occluders, strict=True)}
    views = make_views(
        track, scene.model, scene.category, scene.keypoint_names, scene.camera, lambda d: hidden[d.id], config
    )
    chosen = sorted({int(i) for i in np.linspace(0, len(views) - 1, config.start_views)})
    observed = Observed(track, views, track.subset(chosen), [views[i] for i in chosen])
    found = reconstruct(observed, scene)
    overlaps = scene.model.mask_ious(views, [found.state.world_from_object], scene.model.vertices(found.state))
    if float(overlaps.mean()) < minimum_mask_iou:
        return None
    velocity, gain = motion(observed, scene, found)
    fast = float(np.linalg.norm(velocity)) > config.max_speed_m_s
    return "moves" if fast and gain > config.motion_gain else found
