"""Pairs of objects at the same distance, with the same headings, vote for how one set of objects lies in another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Ints
from meshslam.maps.constellation import Constellation, ConstellationConfig, headings_apart, turned
from meshslam.maps.neighbours import GroundGrid, spans

_NEAREST_M = 2.0  # objects nearer than this tell no direction
_SIGMAS = 2.5  # by which what votes may be off
_BLOCK = 500_000  # pairs of pairs that are looked at together
_CELL_RAD, _CELL_M, _CELL_SHARE = 0.1, 2.0, 0.05  # of the votes' cells; and of the set's extent more
_TURNS = 2.0 * np.pi
_NEIGHBOURS = np.array([(a, b, c) for a in (-1, 0, 1) for b in (-1, 0, 1) for c in (-1, 0, 1)])


@dataclass(frozen=True, eq=False)
class Pairs:
    """Two objects of one set, by their distance."""

    first: Ints
    second: Ints
    distance_m: Floats
    bearing_rad: Floats  # from the first to the second

    @staticmethod
    def within(one: Constellation, radius_m: float, *, both_ways: bool) -> Pairs:
        """All that are within the radius, by distance; `both_ways`: each of two is once the first."""
        flat = one.places[:, :2]
        first, second = GroundGrid.of(flat, radius_m).near(flat)
        between = flat[second] - flat[first]
        distance = np.linalg.norm(between, axis=1)
        kept = (distance > _NEAREST_M) & ((first != second) if both_ways else (first < second))
        kept_at = np.flatnonzero(kept)
        order = kept_at[np.argsort(distance[kept_at], kind="stable")]
        bearing = np.arctan2(between[order, 1], between[order, 0])
        return Pairs(first[order], second[order], distance[order], bearing)


def vote(known: Constellation, seen: Constellation, config: ConstellationConfig) -> tuple[Floats, Floats]:
    """Turns (n,) about z, and where the middle of `seen` then lies in `known` (n, 2), most votes first."""
    yaws, middles = [np.zeros(0)], [np.zeros((0, 2))]
    centre = seen.places[:, :2].mean(0)
    for a, b, yaw in _agreeing(known, seen, config):
        flat = known.places[:, :2]
        middle = (flat[a[0]] + flat[a[1]]) / 2
        away = centre - (seen.places[b[0], :2] + seen.places[b[1], :2]) / 2
        yaws.append(yaw)
        middles.append(middle + turned(away, yaw))
    return most_voted(np.concatenate(yaws), np.concatenate(middles), seen, config.candidates)


def _agreeing(
    known: Constellation, seen: Constellation, config: ConstellationConfig
) -> Iterator[tuple[tuple[Ints, Ints], tuple[Ints, Ints], Floats]]:
    """Pairs of `known` and of `seen` that may be the same two objects, and the turn that lays one on the other."""
    of_known = Pairs.within(known, config.pair_radius_m, both_ways=True)
    of_seen = Pairs.within(seen, config.pair_radius_m, both_ways=False)
    slack = slack_m(known, seen, of_seen, config)
    low = np.searchsorted(of_known.distance_m, of_seen.distance_m - slack, "left")
    high = np.searchsorted(of_known.distance_m, of_seen.distance_m + slack, "right")
    turn_rad = _SIGMAS * np.radians(config.heading_sigma_deg) * np.sqrt(2)
    for block in _blocks(high - low):
        b, a = spans(low[block], high[block])
        b = block[b]
        yaw = of_known.bearing_rad[a] - of_seen.bearing_rad[b]
        agrees = np.ones(len(a), bool)
        for ends in ("first", "second"):
            k, s = getattr(of_known, ends)[a], getattr(of_seen, ends)[b]
            off = np.abs(headings_apart(known.yaws_rad[k], seen.yaws_rad[s] + yaw))
            agrees &= off <= turn_rad + slack[b] / of_seen.distance_m[b]
            sizes = np.abs(np.log(known.sizes[k] / seen.sizes[s])).max(1)
            agrees &= sizes <= _SIGMAS * np.sqrt(2) * config.size_sigma
        a, b, yaw = a[agrees], b[agrees], yaw[agrees]
        yield (of_known.first[a], of_known.second[a]), (of_seen.first[b], of_seen.second[b]), yaw


def slack_m(known: Constellation, seen: Constellation, pairs: Pairs, config: ConstellationConfig) -> Floats:
    """By how much the distance of two objects may differ, for each pair of `seen`."""
    own = seen.sigmas_m[pairs.first] ** 2 + seen.sigmas_m[pairs.second] ** 2 + 2 * np.median(known.sigmas_m) ** 2
    drift = (config.drift_share * pairs.distance_m) ** 2
    found: Floats = _SIGMAS * np.sqrt(4 * config.place_sigma_m**2 + own + drift)
    return found


def _blocks(counts: Ints) -> Iterator[Ints]:
    """Rows, so many together that their counts stay within a block."""
    number = np.cumsum(counts) // _BLOCK
    for value in np.unique(number).tolist():
        yield np.flatnonzero(number == value)


def most_voted(yaws: Floats, middles: Floats, seen: Constellation, count: int) -> tuple[Floats, Floats]:
    """The mean vote of the fullest cells of turn and place; a cell counts with those about it."""
    if not len(yaws):
        return yaws, middles
    turns, cell_m = round(_TURNS / _CELL_RAD), _CELL_M + _CELL_SHARE * seen.extent_m
    cells = np.column_stack([np.floor(yaws % _TURNS / _TURNS * turns), np.floor(middles / cell_m)]).astype(np.int64)
    keys, first, member, votes = np.unique(
        _cell_keys(cells, turns), return_index=True, return_inverse=True, return_counts=True
    )
    occupied, member = cells[first], member.reshape(-1)
    about = np.zeros(len(occupied), np.int64)
    for step in _NEIGHBOURS:
        wanted = _cell_keys(occupied + step, turns)
        at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        about += np.where(keys[at] == wanted, votes[at], 0)
    best = np.lexsort((np.arange(len(occupied)), -votes, -about))[:count]
    rank = np.full(len(occupied), -1)
    rank[best] = np.arange(len(best))
    chosen = rank[member]
    there = chosen >= 0
    total = np.bincount(chosen[there], minlength=len(best)).astype(float)

    def mean(values: Floats) -> Floats:
        mean_votes: Floats = np.bincount(chosen[there], values[there], len(best)) / total
        return mean_votes

    yaw = np.arctan2(mean(np.sin(yaws)), mean(np.cos(yaws)))
    return yaw, np.column_stack([mean(middles[:, 0]), mean(middles[:, 1])])


def _cell_keys(cells: Ints, turns: int) -> Ints:
    """One number for each cell (n, 3); turns go round."""
    found: Ints = ((cells[:, 1] * 2**24) + cells[:, 2]) * np.int64(1024) + cells[:, 0] % turns
    return found
