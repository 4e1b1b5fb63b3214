"""A way off a street: along the oncoming lane, round a corner to the right, and on."""

from __future__ import annotations

import numpy as np

from meshslam.geometry import Floats
from meshslam.simulation.fronts import Wall
from meshslam.simulation.road import Road

_STEP_M = 0.5
_COMES_FROM_M = 18.0  # before the corner
_GOES_ON_M = 60.0  # after it
_ROOM_M = 3.5  # to what stands beside the way


def turning_line(road: Road, at_m: float, lane_m: float, radius_m: float) -> Road:
    """The way against a road's direction, from `_COMES_FROM_M` before the corner at `at_m`; its `along` begins at 0."""
    before = np.arange(at_m + _COMES_FROM_M, at_m, -_STEP_M)
    straight = np.array([road.point(float(along), lane_m) for along in before])
    corner, heading = road.point(at_m, lane_m), road.heading_rad(at_m) + np.pi
    turned = np.append(np.arange(0.0, np.pi / 2, _STEP_M / radius_m), np.pi / 2)
    arc = np.column_stack([radius_m * np.sin(turned), radius_m * (np.cos(turned) - 1.0), np.zeros(len(turned))])
    onward = arc[-1] + np.outer(np.arange(_STEP_M, _GOES_ON_M, _STEP_M), [0.0, -1.0, 0.0])
    c, s = np.cos(heading), np.sin(heading)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Road(np.concatenate([straight, corner + np.concatenate([arc, onward]) @ rotation.T]))


def near(line: Road, place: Floats) -> bool:
    """Whether a place (3,) is in the way off the street."""
    after = line.line[int(_COMES_FROM_M / _STEP_M) :, :2]
    return bool(np.linalg.norm(after - place[:2], axis=1).min() < _ROOM_M)


def crosses(line: Road, wall: Wall) -> bool:
    """Whether the way goes through a house front, or close by it."""
    along = np.linspace(0.0, 1.0, 2 + int(np.linalg.norm(wall.end - wall.start)))[:, None]
    return any(near(line, place) for place in wall.start + along * (wall.end - wall.start))
