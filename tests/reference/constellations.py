"""The slow, readable twin of `meshslam.maps.match_constellations`: every pair is laid on every other pair.

No grid, no votes, no arrays: each two objects of one set are laid on each two of the other, the pose is fitted to all
objects that come to lie near each other, and the pose with the most of them wins.
"""

import itertools

import numpy as np


def turned(point, yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * point[0] - s * point[1], s * point[0] + c * point[1]])


def half_turn_apart(one, other):
    """Difference of headings, either way round."""
    return abs((one - other + np.pi / 2) % np.pi - np.pi / 2)


def best_pose(known, seen, within_m=0.8, heading_rad=0.3, ratio=0.2):
    """Yaw, shift (2,) and pairs (known, seen) of the pose that lays most objects on others."""
    best = (0.0, np.zeros(2), [])
    for (a, b), (i, j) in itertools.product(
        itertools.permutations(range(len(known)), 2), itertools.combinations(range(len(seen)), 2)
    ):
        one, other = known.places[b, :2] - known.places[a, :2], seen.places[j, :2] - seen.places[i, :2]
        if abs(np.linalg.norm(one) - np.linalg.norm(other)) > within_m:
            continue
        yaw = np.arctan2(one[1], one[0]) - np.arctan2(other[1], other[0])
        middle = (known.places[a, :2] + known.places[b, :2]) / 2
        shift = middle - turned((seen.places[i, :2] + seen.places[j, :2]) / 2, yaw)
        pairs = _pairs(known, seen, yaw, shift, within_m, heading_rad, ratio)
        if len(pairs) > len(best[2]):
            best = (*_fitted(known, seen, pairs, yaw), pairs)
    return best


def _pairs(known, seen, yaw, shift, within_m, heading_rad, ratio):
    """One to one, the nearest first."""
    near = []
    for k, s in itertools.product(range(len(known)), range(len(seen))):
        gap = np.linalg.norm(turned(seen.places[s, :2], yaw) + shift - known.places[k, :2])
        alike = np.abs(np.log(known.sizes[k] / seen.sizes[s])).max() <= ratio
        if gap <= within_m and alike and half_turn_apart(known.yaws_rad[k], seen.yaws_rad[s] + yaw) <= heading_rad:
            near.append((gap, k, s))
    pairs = []
    for _, k, s in sorted(near):
        if all(k != other and s != another for other, another in pairs):
            pairs.append((k, s))
    return sorted(pairs)


def _fitted(known, seen, pairs, yaw):
    if len(pairs) < 2:
        return yaw, np.zeros(2)
    p = np.array([seen.places[s, :2] for _, s in pairs])
    q = np.array([known.places[k, :2] for k, _ in pairs])
    a, b = p - p.mean(0), q - q.mean(0)
    yaw = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    return yaw, q.mean(0) - turned(p.mean(0), yaw)
