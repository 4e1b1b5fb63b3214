"""Loop closure: landmarks in view that stand to each other as older landmarks do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.settings import Settings, expert, public


@dataclass(frozen=True)
class LoopClosureConfig(Settings):
    """How loops are closed."""

    enabled: bool = public(True, doc="recognize places that were seen before by their objects")
    min_views: int = expert(8, low=1)  # of a landmark in view, before it is compared
    max_distance_m: float = expert(25.0, above=0)  # and so near must it have been
    radius_m: float = expert(1.0, above=0)  # about where a known landmark is expected,
    drift_share: float = expert(0.02, low=0, high=1)  # and so much more of the way drifted since it was seen,
    max_radius_m: float = expert(12.0, low="radius_m")  # at most
    heading_deg: float = expert(12.0, above=0, high=180)
    size_ratio: float = expert(0.15, low=0)  # of length, width and height, as logarithm
    place_sigma_m: float = expert(0.5, above=0)  # of one object against the others,
    turn_sigma_rad: float = expert(0.03, low=0)  # and so much more for every metre between them
    min_separation_m: float = expert(2.5, low=0)  # of two objects
    min_objects: int = expert(3, low=1)  # that must agree, where the path has drifted by more than
    single_object_radius_m: float = expert(2.0, low=0)  # this; else one is enough


@dataclass(frozen=True, eq=False)
class PlacedLandmark:
    """A landmark with its place in the map, as far as that is known."""

    number: int
    track: int
    pose: Pose
    dimensions: Floats  # (3,)


@dataclass(frozen=True, eq=False)
class LoopClosure:
    """Landmarks in view that are older ones, (in view, older), and how the odometry's world is to be moved."""

    pairs: tuple[tuple[int, int], ...]
    correction: Pose


def match_landmarks(
    seen: Sequence[PlacedLandmark], known: Sequence[PlacedLandmark], radii_m: Sequence[float], config: LoopClosureConfig
) -> LoopClosure | None:
    """The largest set of pairs that one small motion explains; None if it is too small.

    `radii_m`: how far from its place in the map each known landmark may be observed. Rotations are small and about the
    vertical. One pair gives a translation; another pair agrees if its own translation differs by no more than a small
    rotation explains at the distance between the two. A pair of one track, which a tracker took for one object before
    its place was known, counts twice.
    """
    pairs = _candidates(seen, known, radii_m, config)
    best: list[tuple[int, int]] = []
    for i, a in pairs:
        agreeing = _agreeing(seen, known, pairs, (i, a), config)
        if len(agreeing) > len(best):
            best = agreeing
    if not best:
        return None
    correction = _motion(
        np.array([seen[i].pose.translation for i, _ in best]), np.array([known[a].pose.translation for _, a in best])
    )
    left = [np.linalg.norm(correction.transform(seen[i].pose.translation) - known[a].pose.translation) for i, a in best]
    one_suffices = all(radii_m[a] <= config.single_object_radius_m for _, a in best)
    needed = (1 if one_suffices else config.min_objects) + 2 * _contradictions(seen, known, best, correction, config)
    if len(best) + _of_one_track(seen, known, best) < needed or max(left) > config.place_sigma_m:
        return None
    return LoopClosure(tuple((seen[i].number, known[a].number) for i, a in best), correction)


def _of_one_track(
    seen: Sequence[PlacedLandmark], known: Sequence[PlacedLandmark], pairs: Sequence[tuple[int, int]]
) -> int:
    """How many pairs have one track."""
    return sum(seen[i].track == known[a].track for i, a in pairs)


def _contradictions(
    seen: Sequence[PlacedLandmark],
    known: Sequence[PlacedLandmark],
    pairs: Sequence[tuple[int, int]],
    correction: Pose,
    config: LoopClosureConfig,
) -> int:
    """How many other landmarks in view would overlap older landmarks of other tracks that they are not paired with.

    One that overlaps an older one of its own track is that object with a wrong heading or size.
    """
    paired, taken = {i for i, _ in pairs}, {a for _, a in pairs}
    free = [other for a, other in enumerate(known) if a not in taken]
    return sum(
        any(
            other.track != one.track
            and np.linalg.norm(correction.transform(one.pose.translation) - other.pose.translation)
            < config.min_separation_m
            for other in free
        )
        for i, one in enumerate(seen)
        if i not in paired
    )


def _candidates(
    seen: Sequence[PlacedLandmark], known: Sequence[PlacedLandmark], radii_m: Sequence[float], config: LoopClosureConfig
) -> list[tuple[int, int]]:
    if not seen or not known:
        return []
    least, at = np.cos(np.radians(config.heading_deg)), np.array([other.pose.translation for other in known])
    found = []
    for i, one in enumerate(seen):
        near = np.linalg.norm(at - one.pose.translation, axis=1) <= radii_m
        for a in np.flatnonzero(near).tolist():
            along = float(one.pose.rotation[:, 0] @ known[a].pose.rotation[:, 0]) >= least
            if along and np.abs(np.log(one.dimensions / known[a].dimensions)).max() <= config.size_ratio:
                found.append((i, a))
    return found


def _agreeing(
    seen: Sequence[PlacedLandmark],
    known: Sequence[PlacedLandmark],
    pairs: Sequence[tuple[int, int]],
    first: tuple[int, int],
    config: LoopClosureConfig,
) -> list[tuple[int, int]]:
    """The pairs that move as the first does, one to one, the best first."""
    i, a = first
    motion = known[a].pose.translation - seen[i].pose.translation
    ranked = []
    for j, b in pairs:
        gap = float(np.linalg.norm(known[b].pose.translation - seen[j].pose.translation - motion))
        apart = float(np.linalg.norm(seen[j].pose.translation - seen[i].pose.translation))
        slack = config.place_sigma_m + config.turn_sigma_rad * apart
        if gap <= slack:
            ranked.append((gap / slack, j, b))
    taken_seen, taken_known, kept = set(), set(), []
    for _, j, b in sorted(ranked):
        if j not in taken_seen and b not in taken_known:
            taken_seen.add(j)
            taken_known.add(b)
            kept.append((j, b))
    return kept


def _motion(points: Floats, targets: Floats) -> Pose:
    """The turn about the vertical and the translation that lay points (n, 3) on targets; no turn where n < 3."""
    middle, aim = points.mean(0), targets.mean(0)
    turn = 0.0
    if len(points) > 2:
        p, q = (points - middle)[:, :2], (targets - aim)[:, :2]
        turn = float(np.arctan2((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum(), (p * q).sum()))
    moved = Pose.from_yaw(turn, np.zeros(3))
    return Pose(moved.rotation, aim - moved.rotation @ middle)
