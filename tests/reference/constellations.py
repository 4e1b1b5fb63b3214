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


def pose_score(known, seen, end, pairs, rules, keep):
    """The slow twin of `ParkedMap.candidates`: rows of score, turn, shift, scale of the best by one pair of `seen`."""
    found = []
    a, b = end
    for pair in pairs:
        for i, j in (pair, pair[::-1]):
            laid = _laid(known, seen, (i, j), end, rules)
            if laid is not None:
                yaw, shift, turn_variance, scale, cost = laid
                middle = (seen.places[a] + seen.places[b])[:2] / 2
                shown = dict(zip(end, (i, j), strict=True))
                score = _score(known, seen, yaw, shift, middle, turn_variance, scale, rules, shown) - cost
                if score > 0:
                    found.append((score, (yaw + np.pi) % (2 * np.pi) - np.pi, *shift, scale))
    found.sort(key=lambda row: (-row[0], *row[1:]))
    return np.array(found[:keep]).reshape(-1, 5)


def _apart(one, other):
    return (one - other + np.pi / 2) % np.pi - np.pi / 2


def _laid(known, seen, pair, end, rules):
    for k, s in zip(pair, end, strict=True):
        if np.abs(np.log(known.sizes[k] / seen.sizes[s])).max() > 2.5 * np.sqrt(
            rules.size_variance + rules.scale_sigma**2
        ):
            return None
    of_known = (known.places[pair[1]] - known.places[pair[0]])[:2]
    of_seen = (seen.places[end[1]] - seen.places[end[0]])[:2]
    length, seen_length = np.linalg.norm(of_known), np.linalg.norm(of_seen)
    variance = 2 * rules.place_variance_m2 + (rules.drift_share * seen_length) ** 2
    variance += (known.sigmas_m[list(pair)] ** 2).sum() + (seen.sigmas_m[list(end)] ** 2).sum()
    measured, prior, away = variance / seen_length**2, rules.scale_sigma**2, length / seen_length - 1
    if abs(away) > 2.5 * np.sqrt(prior + measured):
        return None
    scale, cost = 1 + away * prior / (prior + measured), 0.5 * away**2 / (prior + measured)
    yaw = np.arctan2(of_known[1], of_known[0]) - np.arctan2(of_seen[1], of_seen[0])
    turn_variance = variance / seen_length**2
    most = 2.5 * np.sqrt(2 * rules.heading_sigma_rad**2 + turn_variance)
    if any(abs(_apart(known.yaws_rad[k], seen.yaws_rad[s] + yaw)) > most for k, s in zip(pair, end, strict=True)):
        return None
    here = (seen.places[end[0]] + seen.places[end[1]])[:2] / 2
    there = (known.places[pair[0]] + known.places[pair[1]])[:2] / 2
    return yaw, there - scale * _turn(here, yaw), turn_variance, scale, cost


def _turn(point, yaw):
    return np.array([np.cos(yaw) * point[0] - np.sin(yaw) * point[1], np.sin(yaw) * point[0] + np.cos(yaw) * point[1]])


def _score(known, seen, yaw, shift, middle, turn_variance, scale, rules, shown):
    total = 0.0
    for s in range(len(seen)):
        place = scale * _turn(seen.places[s, :2], yaw) + shift
        lever = np.linalg.norm(seen.places[s, :2] - middle)
        own = rules.place_variance_m2 + seen.sigmas_m[s] ** 2 + lever**2 * (rules.drift_share**2 + turn_variance)
        best = 0.0
        for k in [shown[s]] if s in shown else range(len(known)):
            gap = ((known.places[k, :2] - place) ** 2).sum()
            variance = own + known.sigmas_m[k] ** 2
            turn = _apart(known.yaws_rad[k], seen.yaws_rad[s] + yaw) / rules.heading_sigma_rad
            miss = gap / variance + 0.5 * turn**2
            if gap > 16.0 or miss > rules.gate**2:
                continue
            same, other = rules.size_variance, rules.other_size_variance
            sizes = np.log(known.sizes[k] / seen.sizes[s] / scale)
            gain = np.log(1 / (2 * np.pi * variance * rules.objects_per_m2)) - miss / 2
            gain += 0.5 * (np.log(other / same) - sizes**2 * (1 / same - 1 / other)).sum()
            best = max(best, gain)
        total += best
    return total
