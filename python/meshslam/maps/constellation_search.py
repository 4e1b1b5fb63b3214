"""Where a handful of objects lies in a map in tiles, by the index of its constellations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from meshslam.geometry import Floats, Ints, ParkedMap, ParkedRules, Pose, parked_rows
from meshslam.maps.constellation import Constellation, ConstellationConfig
from meshslam.maps.constellation_fit import GATE, ConstellationFit, fit_constellation, search_radius_m
from meshslam.maps.constellation_index import ConstellationIndex, Shard
from meshslam.maps.constellation_votes import Pairs, slack_m
from meshslam.maps.constellations import ConstellationMatch, decided, differ, refused
from meshslam.maps.neighbours import GroundGrid

_MOST_PAIRS = 3  # of the handful that are looked up
_SIGMAS = 2.5  # by which a distance may be off
_KEPT = 64  # candidates of a shard
_BESIDE_M = 15.0  # about the handful, where objects speak for a place or against it


def find_constellation(
    index: ConstellationIndex,
    seen: Constellation,
    config: ConstellationConfig | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> ConstellationMatch:
    """As `match_constellations`, in a map in tiles: pairs are (object's id, row of `seen`).

    Few pairs of `seen` are looked up by their distance, and laid on those of the map. Lengths are metres.

    Example:
        found = find_constellation(city.constellations(40.0), Constellation.of(cars_around_the_camera))
        found.refused or found.known_from_seen

    """
    config = config or ConstellationConfig()
    if min(len(index), len(seen)) < config.min_objects:
        return refused(f"it has {min(len(index), len(seen))} objects, {config.min_objects} must be shared")
    pairs = Pairs.within(seen, config.pair_radius_m, both_ways=False)
    rows = _chosen(pairs, seen, config)
    found = [np.zeros((0, 5))]
    for shard in index.shards(progress):
        found.append(_candidates(shard, seen, pairs, rows, config))
    fits = [
        _fitted(index, seen, pose, scale, config)
        for pose, scale in _spread(np.concatenate(found), seen, config.candidates)
    ]
    return decided([fit for fit in fits if len(fit.known) > 1], seen, config)


def _chosen(pairs: Pairs, seen: Constellation, config: ConstellationConfig) -> Ints:
    """The pairs of `seen` that tell a pose best, no object in many of them: some may not be in the map."""
    slack = _slack_m(seen, seen, pairs, config)
    vagueness = slack * slack / pairs.distance_m  # how many pairs are about as far apart, and how well they tell a turn
    used, chosen = np.zeros(len(seen)), list[int]()
    for _ in range(min(_MOST_PAIRS, len(slack))):
        cost = vagueness * (1 + used[pairs.first]) * (1 + used[pairs.second])
        cost[chosen] = np.inf
        chosen.append(int(cost.argmin()))
        used[[pairs.first[chosen[-1]], pairs.second[chosen[-1]]]] += 1
    return np.array(chosen, np.int64)


def _candidates(shard: Shard, seen: Constellation, pairs: Pairs, rows: Ints, config: ConstellationConfig) -> Floats:
    """The best places (k, 5) of `seen` among a shard's objects: score, turn, shift, scale."""
    known = shard.constellation
    distance = pairs.distance_m[rows]
    slack = _slack_m(known, seen, pairs, config)[rows]
    looked_up = [shard.pairs_between(d - s, d + s) for d, s in zip(distance.tolist(), slack.tolist(), strict=True)]
    ends = list(zip(pairs.first[rows].tolist(), pairs.second[rows].tolist(), strict=True))
    return ParkedMap(_rows(known)).candidates(_rows(seen), ends, looked_up, _rules(config), _KEPT)


def _slack_m(known: Constellation, seen: Constellation, pairs: Pairs, config: ConstellationConfig) -> Floats:
    """By how much the distance of two objects may differ, with a scale that is not known."""
    found: Floats = np.hypot(slack_m(known, seen, pairs, config), _SIGMAS * config.scale_sigma * pairs.distance_m)
    return found


def _rows(seen: Constellation) -> Floats:
    return parked_rows(seen.places, seen.yaws_rad, seen.sizes, seen.sigmas_m)


def _rules(config: ConstellationConfig) -> ParkedRules:
    same, heading_rad = 2 * config.size_sigma**2, float(np.radians(config.heading_sigma_deg))
    return ParkedRules(
        place_variance_m2=2 * config.place_sigma_m**2,
        drift_share=config.drift_share,
        heading_sigma_rad=heading_rad,
        size_variance=same,
        other_size_variance=same + 2 * config.size_spread**2,
        objects_per_m2=config.cars_per_m2,
        gate=GATE,
        scale_sigma=config.scale_sigma,
    )


def _spread(found: Floats, seen: Constellation, count: int) -> list[tuple[Pose, float]]:
    """The best candidates that lay the objects in different places, with their scales."""
    middle, kept = seen.places.mean(0), list[tuple[Pose, float]]()
    for _, yaw, x, y, scale in found[np.lexsort((*found.T[4:0:-1], -found[:, 0]))].tolist():
        pose = Pose.from_yaw(yaw, np.array([x, y, 0.0]))
        if all(differ(pose, other, middle) for other, _ in kept):
            kept.append((pose, scale))
        if len(kept) == count:
            break
    return kept


def _fitted(
    index: ConstellationIndex, seen: Constellation, start: Pose, scale: float, config: ConstellationConfig
) -> ConstellationFit:
    """The fit from a candidate, to what stands about it; `known` are ids."""
    middle = start.transform(scale * seen.places.mean(0)[None])[0, :2]
    ids, about = index.around(middle, scale * seen.extent_m + _BESIDE_M)
    grid = GroundGrid.of(about.places[:, :2], search_radius_m(about, seen, config))
    fit = fit_constellation(about, seen, grid, start, config, among=len(index), scale=scale)
    return replace(fit, known=ids[fit.known])
