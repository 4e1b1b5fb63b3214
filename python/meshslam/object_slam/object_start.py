"""From a track that was seen long enough to the first estimate of its object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

import numpy as np

from meshslam.geometry import Bytes
from meshslam.object_slam.observations import TrackObservation
from meshslam.objects import Reconstruction, Scene, Track, TrackObservations, make_views, motion, reconstruct


@dataclass
class Candidate:
    """A track that is not an object yet."""

    observations: list[TrackObservation] = field(default_factory=list)
    next_try: int = 0  # number of observations


class NoObject(Enum):
    """Why a track gives no object."""

    DOES_NOT_FIT = auto()
    MOVES = auto()


def object_of(track: Track, occluders: Sequence[Bytes], scene: Scene, min_mask_iou: float) -> Reconstruction | NoObject:
    """The object of a track, `occluders` being what hides it in each of its detections."""
    config = scene.config
    hidden = {d.id: occluder for d, occluder in zip(track.detections, occluders, strict=True)}
    views = make_views(
        track, scene.model, scene.category, scene.keypoint_names, scene.camera, lambda d: hidden[d.id], config
    )
    chosen = sorted({int(i) for i in np.linspace(0, len(views) - 1, config.start_views)})
    observed = TrackObservations(track, views, track.subset(chosen), [views[i] for i in chosen])
    found = reconstruct(observed, scene)
    overlaps = scene.model.mask_ious(views, [found.state.world_from_object], scene.model.vertices(found.state))
    if float(overlaps.mean()) < min_mask_iou:
        return NoObject.DOES_NOT_FIT
    velocity, gain = motion(observed, scene, found)
    fast = float(np.linalg.norm(velocity)) > config.max_speed_m_s
    return NoObject.MOVES if fast and gain > config.motion_gain else found
