"""The unit of a camera's path by the sizes of the cars that it passes.

Poses that are too long by a factor make every car too large by the same factor, which its category's shapes do not
like. Each car is fitted along the path at several factors e^k. What it is left with, L_i(k), is the likelihood of its
own factor k_i. Cars of a drive have k_i ~ N(k, s^2): their sizes and errors of their masks. So k has the posterior
prod_i (f + int L_i(k_i) N(k_i; k, s^2) dk_i), f for a car that tells nothing, and all cars of a drive may be larger or
smaller than the category's, which is added to its sigma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Floats, Pose
from meshslam.mapping.config import MappingConfig
from meshslam.mapping.judgement import why_unfit
from meshslam.mapping.pipeline import make_scene
from meshslam.mapping.selection import usable_tracks
from meshslam.mapping.work import each, first_pass
from meshslam.maps import CameraPath
from meshslam.objects import ObjectConfig, Occluders, Scene, Track
from meshslam.perception import DetectionSet

LOG_FACTORS = np.linspace(-0.3, 0.3, 9)
_CAR_SIGMA = 0.1  # of the logarithm of one car's factor
_COMMON_SIGMA = 0.06  # of all cars of a drive
_NOTHING = 0.05  # likelihood of a car that tells nothing, of the best
_FAR_M = 10.0  # of the camera's way, more of which tells no more


def size_of_cars(
    frames: CameraPath,
    detections: DetectionSet,
    category: Category,
    objects: ObjectConfig,
    config: MappingConfig,
    *,
    most: int,
) -> tuple[float, float, int] | None:
    """Logarithm of true over given lengths of a path, by the sizes of cars; its sigma, and the number of cars.

    Nothing is taken from the road. The `most` best seen parked cars are used; None if there is none.
    """
    tracks, _ = usable_tracks(frames, detections, category.name, config, objects.min_view_box_px)
    chosen = sorted(tracks, key=lambda t: (-_told(t), t.id))[:most]
    scene = make_scene(frames, detections, category, objects, use_ground=False)
    occluders = Occluders(frames.camera, detections.by_frame(), frames.pose_of_frame())
    found = each("sizes", lambda track: _costs(track, scene, occluders, config), chosen, None)
    costs = [one for one in found if one is not None]
    if not costs:
        return None
    value, sigma = log_factor(costs)
    return value, sigma, len(costs)


def log_factor(costs: Sequence[Floats]) -> tuple[float, float]:
    """The common k and its sigma from costs, minus log likelihoods, of cars at `LOG_FACTORS`; one or more cars."""
    k = np.linspace(2 * LOG_FACTORS[0], 2 * LOG_FACTORS[-1], 241)
    own = np.linspace(LOG_FACTORS[0], LOG_FACTORS[-1], 121)
    spread = np.exp(-0.5 * ((k[:, None] - own) / _CAR_SIGMA) ** 2)
    logs = np.zeros(len(k))
    for cost in costs:
        likelihood = spread @ np.exp(cost.min() - np.interp(own, LOG_FACTORS, cost))
        logs = logs + np.log(likelihood / likelihood.max() + _NOTHING)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    value = float(weights @ k)
    return value, float(np.sqrt(weights @ (k - value) ** 2 + _COMMON_SIGMA**2))


def _costs(track: Track, scene: Scene, occluders: Occluders, config: MappingConfig) -> Floats | None:
    """What the fit of one car costs at each of `LOG_FACTORS`; None for what is no parked car."""
    work = first_pass(track, scene, occluders)
    if why_unfit(work, scene, config, judge_shape=False) is not None:
        return None
    origin, place = track.world_from_camera[0].translation, work.found.posed.world_from_object
    costs = []
    for k in LOG_FACTORS.tolist():
        poses = tuple(_about(origin, pose, k) for pose in track.world_from_camera)
        again = first_pass(replace(track, world_from_camera=poses), scene, occluders, _about(origin, place, k))
        costs.append(again.found.cost)
    return np.array(costs)


def _about(origin: Floats, pose: Pose, k: float) -> Pose:
    """A pose e^k times as far from a place."""
    return Pose(pose.rotation, origin + np.exp(k) * (pose.translation - origin))


def _told(track: Track) -> float:
    """How much of its size a track can show: its largest box, and how far the camera goes meanwhile."""
    centres = np.array([pose.translation for pose in track.world_from_camera])
    way = float(np.linalg.norm(centres - centres[0], axis=1).max())
    return max(d.bbox[2] for d in track.detections) * min(way, _FAR_M)
