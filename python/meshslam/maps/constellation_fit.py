"""How well one set of objects fits into another at a pose: one to one, and weighed against chance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Ints, Pose
from meshslam.maps.constellation import Constellation, ConstellationConfig, headings_apart
from meshslam.maps.neighbours import GroundGrid

_ROUNDS = 4  # of matching and fitting
_WIDE = 2.0  # the gate of all but the last two is wider by so much: two objects alone tell a pose roughly
GATE = 3.0  # sigmas
_YAW_SIGMA_RAD = 0.05  # to which a constellation tells its heading, among the headings that could have been
_SCALE_SIGMA, _LEAST_SCALE = 0.005, 0.5  # to which a constellation tells its scale; and no scale is less
_OVERLAP_M, _OVERLAP_COST = 2.0, 1.0  # cars of both sets cannot stand so near, unless one has moved
_BESIDE_M = 12.0  # from a shared object, where others should be shared, too


@dataclass(frozen=True, eq=False)
class ConstellationFit:
    """Pairs at a pose; row i says that `known[i]` is `seen[i]`."""

    known_from_seen: Pose  # a turn about z and a shift, after the scale
    known: Ints
    seen: Ints
    evidence: float  # logarithm of the odds against chance
    agreement: float  # what a pair adds to it, mean
    scale: float = 1.0  # by which the lengths of `seen` are multiplied


def search_radius_m(known: Constellation, seen: Constellation, config: ConstellationConfig) -> float:
    """Beyond this no pair is within the gate."""
    own = float(known.sigmas_m.max() ** 2 + seen.sigmas_m.max() ** 2)
    sigma = np.sqrt(2 * config.place_sigma_m**2 + (config.drift_share * seen.extent_m) ** 2 + own)
    return max(float(GATE * _WIDE * sigma), _OVERLAP_M)


def fit_constellation(
    known: Constellation,
    seen: Constellation,
    grid: GroundGrid,
    start: Pose,
    config: ConstellationConfig,
    among: int | None = None,
    scale: float = 1.0,
) -> ConstellationFit:
    """Match and fit in turns from a start, whose height is not known; `grid` holds the places of `known`.

    `among`: how many objects the place was chosen from, where `known` are those of one place alone.
    """
    pose, level, own = start, False, seen.scaled(scale)
    k = s = np.zeros(0, np.int64)
    middle = own.places[:, :2].mean(0)
    for number in range(_ROUNDS + 1):
        wide = _WIDE if number < _ROUNDS - 2 else 1.0
        k, s, gains, near = _matched(known, own, grid, pose, middle, config, wide, level=level)
        if len(k) < 2:
            return ConstellationFit(pose, k, s, 0.0, 0.0, scale)
        if number < _ROUNDS:
            scale = _fitted_scale(known, seen, k, s, config) if config.scale_sigma > 0 else 1.0
            own = seen.scaled(scale)
            pose, middle, level = fitted_pose(known, own, k, s, pose.yaw_rad), own.places[s, :2].mean(0), True
    evidence = _evidence(known, own, k, s, gains, near, config, among or len(known)) - _scale_cost(scale, config)
    return ConstellationFit(pose, k, s, evidence, float(gains.mean()), scale)


def _fitted_scale(known: Constellation, seen: Constellation, k: Ints, s: Ints, config: ConstellationConfig) -> float:
    """By which `seen` is as large as what it is laid on, with the prior about 1."""
    weight = 1.0 / (2 * config.place_sigma_m**2 + known.sigmas_m[k] ** 2 + seen.sigmas_m[s] ** 2)
    aim = known.places[k, :2] - weight @ known.places[k, :2] / weight.sum()
    own = seen.places[s, :2] - weight @ seen.places[s, :2] / weight.sum()
    along = weight @ (own * aim).sum(1)
    across = weight @ (own[:, 0] * aim[:, 1] - own[:, 1] * aim[:, 0])
    prior = config.scale_sigma**-2
    return max(float((np.hypot(along, across) + prior) / (weight @ (own**2).sum(1) + prior)), _LEAST_SCALE)


def _scale_cost(scale: float, config: ConstellationConfig) -> float:
    """Of a scale beside 1, and of its choice."""
    if config.scale_sigma == 0:
        return 0.0
    chosen = max(0.0, float(np.log(config.scale_sigma / _SCALE_SIGMA)))
    return 0.5 * ((scale - 1.0) / config.scale_sigma) ** 2 + chosen


def fitted_pose(known: Constellation, seen: Constellation, k: Ints, s: Ints, yaw_rad: float) -> Pose:
    """The turn about z and the shift that lay objects on their pairs, weighted by their sigmas; two or more pairs."""
    weight = 1.0 / (0.05**2 + known.sigmas_m[k] ** 2 + seen.sigmas_m[s] ** 2)
    weight = weight / weight.sum()
    aim, middle = weight @ known.places[k], weight @ seen.places[s]
    p, q = seen.places[s, :2] - middle[:2], known.places[k, :2] - aim[:2]
    across, along = weight @ (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]), weight @ (p * q).sum(1)
    turn = float(np.arctan2(across, along)) if np.hypot(across, along) > 1e-9 else yaw_rad
    moved = Pose.from_yaw(turn, np.zeros(3))
    return Pose(moved.rotation, aim - moved.rotation @ middle)


def _matched(
    known: Constellation,
    seen: Constellation,
    grid: GroundGrid,
    pose: Pose,
    middle: Floats,
    config: ConstellationConfig,
    wide: float,
    *,
    level: bool,
) -> tuple[Ints, Ints, Floats, Ints]:
    """Pairs one to one, the likeliest first, with their gains; and what of `seen` overlaps any of `known`."""
    placed = pose.transform(seen.places)
    s, k = grid.near(placed[:, :2])
    away = placed[s] - known.places[k]
    far = np.linalg.norm(seen.places[s, :2] - middle, axis=1)
    variance = 2 * config.place_sigma_m**2 + (config.drift_share * far) ** 2
    variance = variance + known.sigmas_m[k] ** 2 + seen.sigmas_m[s] ** 2
    gap = (away[:, :2] ** 2).sum(1)
    near = s[gap < _OVERLAP_M**2]
    turn = headings_apart(known.yaws_rad[k], seen.yaws_rad[s] + pose.yaw_rad)
    sizes = np.log(known.sizes[k] / seen.sizes[s])
    miss = gap / variance + 0.5 * (turn / np.radians(config.heading_sigma_deg)) ** 2
    if level:
        miss = miss + (away[:, 2] / config.height_sigma_m) ** 2
    same, different = 2 * config.size_sigma**2, 2 * config.size_sigma**2 + 2 * config.size_spread**2
    size_gain = 0.5 * (np.log(different / same) - sizes**2 * (1 / same - 1 / different)).sum(1)
    gain = np.log(1 / (2 * np.pi * variance * config.cars_per_m2)) + size_gain - 0.5 * miss
    within = (miss <= GATE**2 * wide**2 * 1.5) & (gain + (0.0 if wide == 1.0 else 2.0) > 0)
    chosen = _one_to_one(s[within], k[within], gain[within])
    at = np.flatnonzero(within)[chosen]
    return k[at], s[at], gain[at], np.unique(near)


def _one_to_one(s: Ints, k: Ints, gain: Floats) -> Ints:
    """Rows of which no two share an object, taken by their gains."""
    taken_seen, taken_known, kept = set(), set(), []
    for row in np.lexsort((k, s, -gain)).tolist():
        if s[row] not in taken_seen and k[row] not in taken_known:
            taken_seen.add(s[row])
            taken_known.add(k[row])
            kept.append(row)
    return np.array(kept, np.int64)


def _evidence(
    known: Constellation,
    seen: Constellation,
    k: Ints,
    s: Ints,
    gains: Floats,
    near: Ints,
    config: ConstellationConfig,
    among: int,
) -> float:
    """The pairs' gains, less what is won by choosing a pose freely: one object can be laid on any other."""
    variance = 2 * config.place_sigma_m**2 + known.sigmas_m[k] ** 2 + seen.sigmas_m[s] ** 2
    first = float(np.log(1 / (2 * np.pi * variance * config.cars_per_m2)).mean())
    chosen = first + np.log(among) + np.log(2 * np.pi / _YAW_SIGMA_RAD) / 2
    overlapping = len(set(near.tolist()) - set(s.tolist()))
    alone = _unshared_beside(known.places, k) + _unshared_beside(seen.places, s)
    return float(gains.sum() - chosen - _OVERLAP_COST * overlapping - config.unshared_cost * alone)


def _unshared_beside(places: Floats, shared: Ints) -> int:
    """How many objects stand beside a shared one and are not shared."""
    grid = GroundGrid.of(places[shared][:, :2], _BESIDE_M)
    low, high = places[shared].min(0)[:2] - _BESIDE_M, places[shared].max(0)[:2] + _BESIDE_M
    inside = np.flatnonzero(((places[:, :2] >= low) & (places[:, :2] <= high)).all(1))
    about, _ = grid.near(places[inside][:, :2])
    return len(set(inside[about].tolist()) - set(shared.tolist()))
