"""One object that drives, from its track to the map; or why it does not become one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import ObjectState
from meshslam.maps import MovingObject
from meshslam.moving.config import MovingConfig
from meshslam.moving.finish import Shaped, moving_object, with_own_shape
from meshslam.moving.fit import PathFit, fit_path
from meshslam.objects import Occluders, Scene, Track, TrackObservations


@dataclass(frozen=True, eq=False)
class Estimated:
    """A moving object, or the reason why the track is none, with figures."""

    object: MovingObject | None
    doubt: str = ""


def estimate_moving(
    track: Track,
    standing: ObjectState,
    observed: TrackObservations,
    scene: Scene,
    occluders: Occluders,
    config: MovingConfig,
    min_mask_iou: float,
) -> Estimated:
    """Path and mesh of a track that does not fit an object in one place; `standing` is the best such fit."""
    if len(track.detections) < 3 or (np.diff(track.times_s) <= 0).any():
        return Estimated(None, "fewer than 3 times: no path follows")
    try:
        fit = fit_path(track, standing, observed, scene, occluders, config)
        shaped = with_own_shape(fit, scene, occluders)
        doubt = _doubt(fit, shaped, config, min_mask_iou)
        return Estimated(None, doubt) if doubt else Estimated(moving_object(fit, shaped, scene))
    except GeometryError as error:
        return Estimated(None, f"its path cannot be solved: {error}")


def _doubt(fit: PathFit, shaped: Shaped, config: MovingConfig, min_mask_iou: float) -> str:
    """Why the path is not to be believed; empty if it is."""
    state, overlap = fit.state, float(shaped.mask_ious.mean())
    speed = float(np.abs(state.speeds_m_s).mean())
    way = float(np.linalg.norm(state.translations[-1] - state.translations[0]))
    if overlap < min_mask_iou:
        return f"its path does not fit its masks: mean mask IoU {overlap:.2f}"
    if speed < config.min_speed_m_s:
        return f"its path is too slow to be told from one place: {speed:.1f} m/s"
    if way < config.min_way_m:
        return f"its path is too short to be told from one place: {way:.1f} m"
    return ""
