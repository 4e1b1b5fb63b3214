"""What the viewing angles that a network tells say of an object's heading: front or rear."""

from __future__ import annotations

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.objects.start_search import flipped
from meshslam.objects.track import Track

_FLOOR = 0.01  # share of a distribution that is spread evenly: no network is more certain than that
_INDEPENDENT_VIEWS = 4.0  # at most: the views of one car err alike


def heading_cost(track: Track, world_from_object: Pose) -> float:
    """Negative log likelihood of a pose under the track's viewing angles; 0 where no detection tells one.

    The mean over the detections times the number of those that count as independent, relative to an even distribution.
    """
    costs = [
        -float(np.log(likelihood(d.viewing_angle_shares, viewing_angle_rad(pose, world_from_object))))
        for d, pose in zip(track.detections, track.world_from_camera, strict=True)
        if d.viewing_angle_shares is not None
    ]
    return float(np.mean(costs)) * min(len(costs), _INDEPENDENT_VIEWS) if costs else 0.0


def reversed_probability(track: Track, world_from_object: Pose) -> float | None:
    """How likely the object faces the other way, by the track's viewing angles alone; None where none is told."""
    if all(d.viewing_angle_shares is None for d in track.detections):
        return None
    apart = heading_cost(track, world_from_object) - heading_cost(track, flipped(world_from_object))
    return float(1 / (1 + np.exp(-apart)))


def viewing_angle_rad(world_from_camera: Pose, world_from_object: Pose) -> float:
    """Where the camera is, seen from the object: 0 ahead of it, pi / 2 at its left."""
    eye = world_from_object.inverse().transform(world_from_camera.translation)
    return float(np.arctan2(eye[1], eye[0]))


def likelihood(shares: Floats, angle_rad: float) -> float:
    """Density at an angle of shares of n equal bins, up to a factor, linear between centres; 1: as an even one."""
    n = len(shares)
    place = (angle_rad / (2 * np.pi)) % 1.0 * n
    low = int(place) % n
    part = place - int(place)
    value = n * ((1 - part) * shares[low] + part * shares[(low + 1) % n]) / shares.sum()
    return float((1 - _FLOOR) * value + _FLOOR)
