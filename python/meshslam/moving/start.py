"""Where an object that drives may be at each time, before its views are fitted."""

from __future__ import annotations

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.moving.path_state import PathState
from meshslam.objects import Scene, Track, is_cut

_EDGE_PX = 3.0
_WINDOW_S = 0.7  # over which places are taken as on a straight way
_LEAST_SPEED_M_S = 1.0  # below it the way tells no heading
_FLIP = np.diag([-1.0, -1.0, 1.0])


def state_from_velocity(track: Track, pose: Pose, velocity: Floats, time_s: float, modes: int) -> PathState:
    """Straight on from a pose at a time with a velocity (3,), m/s, which is along the pose's x."""
    away = track.times_s - time_s
    poses = tuple(Pose(pose.rotation, pose.translation + velocity * dt) for dt in away)
    speeds = np.full(len(away), float(pose.rotation[:, 0] @ velocity))
    return PathState.of(poses, speeds, np.zeros(len(away)), np.zeros(modes))


def state_from_boxes(track: Track, scene: Scene, heading_rad: float) -> PathState | None:
    """From the boxes' places, smoothed; `heading_rad` where the way tells none. None where too few boxes are whole."""
    places = [_box_place(track, i, scene) for i in range(len(track.detections))]
    known = np.array([place is not None for place in places])
    if known.sum() < 2:
        return None
    found = np.array([place for place in places if place is not None])
    at, velocity = _smoothed(track.times_s, track.times_s[known], found[:, :3], found[:, 3])
    speeds = np.linalg.norm(velocity[:, :2], axis=1)
    headings = _headings(velocity, speeds, heading_rad)
    poses = []
    for place, heading in zip(at, headings, strict=True):
        ground = scene.ground_at(place)
        height = 0.0 if ground is None else ground.height_m(place) - scene.category.dimensions[2] / 2
        poses.append(Pose.from_yaw(float(heading), place - [0.0, 0.0, height]))
    return PathState.of(tuple(poses), speeds, np.zeros(len(speeds)), np.zeros(scene.model.mode_count))


def reversed_state(state: PathState) -> PathState:
    """The same way driven backwards."""
    return PathState(state.rotations @ _FLIP, state.translations, -state.speeds_m_s, -state.curvatures, state.z)


def _box_place(track: Track, i: int, scene: Scene) -> Floats | None:
    """Centre (3,) by the box's height, and how much the box says; None for a box that is cut."""
    detection, pose, camera = track.detections[i], track.world_from_camera[i], scene.camera
    x, y, w, h = detection.bbox
    if is_cut(detection, camera, _EDGE_PX) or y < _EDGE_PX:
        return None
    depth_m = camera.fy * scene.category.dimensions[2] / max(h, 1.0)
    ray = camera.rays(np.array([x + w / 2, y + h / 2]))
    return np.append(pose.transform(ray * depth_m), h**2)


def _smoothed(times_s: Floats, known_s: Floats, places: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Places and velocities (n, 3) of lines through the places near each time, weighted."""
    at, velocity = np.zeros((len(times_s), 3)), np.zeros((len(times_s), 3))
    for i, time_s in enumerate(times_s):
        away = known_s - time_s
        window = max(_WINDOW_S, float(np.sort(np.abs(away))[min(2, len(away) - 1)]))
        weight = np.sqrt(weights * np.exp(-0.5 * (away / window) ** 2))[:, None]
        rows = np.column_stack([np.ones(len(away)), away])
        line = np.linalg.lstsq(weight * rows, weight * places, rcond=None)[0]
        at[i], velocity[i] = line
    return at, velocity


def _headings(velocity: Floats, speeds: Floats, otherwise_rad: float) -> Floats:
    """Directions (n,) of the way; where it is slow, that of the nearest time at which it is not."""
    moves = np.flatnonzero(speeds >= _LEAST_SPEED_M_S)
    if not len(moves):
        return np.full(len(speeds), otherwise_rad)
    nearest = moves[np.abs(np.arange(len(speeds))[:, None] - moves[None]).argmin(1)]
    return np.asarray(np.arctan2(velocity[nearest, 1], velocity[nearest, 0]), float)
