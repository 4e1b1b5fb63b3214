"""Where one set of parked objects lies in another: constellations, by place, heading and size, seen from above.

Worlds are levelled, so that one is laid into another by a turn about z and a shift (4 degrees of freedom). Pairs of
objects vote for such poses; the fullest are fitted one to one, and weighed against cars that stand by chance. A map of
100,000 objects is looked through for a handful.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.maps.constellation import Constellation, ConstellationConfig, turned
from meshslam.maps.constellation_fit import ConstellationFit, fit_constellation, search_radius_m
from meshslam.maps.constellation_votes import vote
from meshslam.maps.neighbours import GroundGrid

_APART_M, _APART_RAD = 1.5, 0.1  # places nearer than this are one


@dataclass(frozen=True, eq=False)
class ConstellationMatch:
    """Where a set of objects lies in a known one; `refused` says why that is not to be believed, or is empty."""

    known_from_seen: Pose  # a turn about z and a shift
    pairs: tuple[tuple[int, int], ...]  # indices (known, seen), one to one
    evidence: float  # logarithm of the odds against chance
    agreement: float  # what a pair adds to the evidence, mean
    ambiguity: float  # the evidence of the next best place, as a share of this one's
    refused: str = ""
    scale: float = 1.0  # by which lengths of `seen` are multiplied first, where the settings leave it open


def match_constellations(
    known: Constellation, seen: Constellation, config: ConstellationConfig | None = None
) -> ConstellationMatch:
    """The pose that lays `seen` into `known` and that most objects speak for, with the ambiguity of that answer.

    An object taken the wrong way round counts as the same heading. A set that lies elsewhere about as well, that shares
    too few objects, or too few against chance, is refused with the reason. Lengths are metres.

    Example:
        found = match_constellations(Constellation.of(city.objects), Constellation.of(drive.objects))
        city_from_drive = None if found.refused else found.known_from_seen

    """
    config = config or ConstellationConfig()
    if min(len(known), len(seen)) < config.min_objects:
        return refused(f"it has {min(len(known), len(seen))} objects, {config.min_objects} must be shared")
    fits = _fits(known, seen, config)
    return decided(fits, seen, config)


def decided(fits: list[ConstellationFit], seen: Constellation, config: ConstellationConfig) -> ConstellationMatch:
    """The best of some candidates, refused with the reason where it is not to be believed."""
    if not fits:
        return refused("no two objects of one stand as two of the other do")
    fits = sorted(fits, key=lambda f: (-f.evidence, -len(f.known)))
    best, middle = fits[0], seen.places.mean(0)
    second = next((fit.evidence for fit in fits[1:] if differ(fit.known_from_seen, best.known_from_seen, middle)), 0.0)
    ambiguity = max(0.0, second / best.evidence) if best.evidence > 0 else 1.0
    pairs = tuple(sorted(zip(best.known.tolist(), best.seen.tolist(), strict=True)))
    why = _why_refused(best, ambiguity, config)
    return ConstellationMatch(best.known_from_seen, pairs, best.evidence, best.agreement, ambiguity, why, best.scale)


def match_near(
    known: Constellation, seen: Constellation, start: Pose, config: ConstellationConfig | None = None
) -> ConstellationMatch:
    """The same where `known_from_seen` is known roughly: nothing is searched for, and nothing else is compared."""
    config = config or ConstellationConfig()
    if not len(known) or not len(seen):
        return refused("it has no objects")
    grid = GroundGrid.of(known.places[:, :2], search_radius_m(known, seen, config))
    fit = fit_constellation(known, seen, grid, start, config)
    pairs = tuple(sorted(zip(fit.known.tolist(), fit.seen.tolist(), strict=True)))
    few = "" if pairs else "no object stands where another does"
    return ConstellationMatch(fit.known_from_seen, pairs, fit.evidence, fit.agreement, 0.0, few, fit.scale)


def _fits(known: Constellation, seen: Constellation, config: ConstellationConfig) -> list[ConstellationFit]:
    """Candidates of two pairs and more."""
    yaws, middles = vote(known, seen, config)
    grid = GroundGrid.of(known.places[:, :2], search_radius_m(known, seen, config))
    shifts = middles - turned(np.broadcast_to(seen.places[:, :2].mean(0), middles.shape), yaws)
    starts = [Pose.from_yaw(y, np.append(shift, 0.0)) for y, shift in zip(yaws.tolist(), shifts, strict=True)]
    fits = [fit_constellation(known, seen, grid, start, config) for start in starts]
    return [fit for fit in fits if len(fit.known) > 1]


def differ(one: Pose, other: Pose, middle: Floats) -> bool:
    """Whether two poses lay objects about a middle in different places."""
    turn = (one.yaw_rad - other.yaw_rad + np.pi) % (2 * np.pi) - np.pi
    gap = (one.transform(middle) - other.transform(middle))[:2]
    return abs(turn) > _APART_RAD or float(np.linalg.norm(gap)) > _APART_M


def refused(why: str) -> ConstellationMatch:
    """No match, and why."""
    return ConstellationMatch(Pose.identity(), (), 0.0, 0.0, 1.0, why)


def _why_refused(best: ConstellationFit, ambiguity: float, config: ConstellationConfig) -> str:
    shared = len(best.known)
    if shared < config.min_objects:
        return f"{shared} objects are shared at best, {config.min_objects} are needed"
    if best.evidence < config.min_evidence:
        needed = f"evidence {best.evidence:.1f}, {config.min_evidence:g} is needed"
        return f"{shared} objects agree at best, which may be chance: {needed}"
    if best.agreement < config.min_agreement:
        needed = f"evidence {best.agreement:.1f} each, {config.min_agreement:g} is needed"
        return f"{shared} objects agree roughly only, as in any street: {needed}"
    if ambiguity > config.max_ambiguity:
        share = f"{ambiguity:.0%} of the best one's evidence, at most {config.max_ambiguity:.0%} is allowed"
        return f"{shared} objects agree, but another place fits about as well: {share}"
    return ""
