"""Which drives are laid on which: constellations of every two, and what holds together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.maps import Constellation, match_constellations, match_near
from meshslam.merging.config import MergingConfig
from meshslam.merging.drives import Drive
from meshslam.merging.places import place_covariance

Progress = Callable[[str, int, int], None]
_DISAGREE_M, _DISAGREE_RAD = 3.0, 0.15  # by which two ways from drive to drive may differ


@dataclass(frozen=True, eq=False)
class Link:
    """Two drives that share cars, (one, other) by their places in the list."""

    one: int
    other: int
    one_from_other: Pose
    pairs: tuple[tuple[int, int], ...]  # ids of cars (of one, of other)
    evidence: float
    ambiguity: float


@dataclass(frozen=True, eq=False)
class Component:
    """Drives that are laid into one world: that of `anchor`."""

    anchor: int
    world_from_drive: dict[int, Pose]  # roughly
    links: tuple[Link, ...]


@dataclass(frozen=True, eq=False)
class Linking:
    """The components, the largest first, and why drives could not be laid on each other."""

    components: tuple[Component, ...]
    refused: dict[tuple[int, int], str]
    conflicts: tuple[str, ...]


def link_drives(drives: Sequence[Drive], config: MergingConfig, progress: Progress | None = None) -> Linking:
    """Compare every two drives, and lay those that share a street into one world, by the most evident links."""
    links, refused = list[Link](), dict[tuple[int, int], str]()
    places = [(list(drive.map), Constellation.of(drive.map.objects)) for drive in drives]
    every = [(i, j) for j in range(len(drives)) for i in range(j)]
    for done, (i, j) in enumerate(every, 1):
        (ids, one), (other_ids, other) = places[i], places[j]
        if config.poses == "global":
            found = match_near(one, other, Pose.identity(), config.constellations)
        else:
            found = match_constellations(one, other, config.constellations)
        pairs = tuple((ids[a], other_ids[b]) for a, b in found.pairs)
        why = found.refused or _why_rough(drives[i], drives[j], found.known_from_seen, pairs, config)
        if why:
            refused[i, j] = why
        else:
            links.append(Link(i, j, found.known_from_seen, pairs, found.evidence, found.ambiguity))
        if progress is not None:
            progress("compare drives", done, len(every))
    if config.poses == "global":
        same = {i: Pose.identity() for i in range(len(drives))}
        return Linking((Component(0, same, tuple(links)),), refused, ())
    return _joined(drives, links, refused, [_middle(seen) for _, seen in places])


def _why_rough(
    one: Drive, other: Drive, one_from_other: Pose, pairs: Sequence[tuple[int, int]], config: MergingConfig
) -> str:
    """Why cars that agree by the constellation's wide gate are not one by what is known of their places; or nothing."""
    errors, gaps = [], []
    for a, b in pairs:
        known, seen = one.map[a], other.map[b]
        pose = one_from_other @ seen.world_from_object
        gap = (pose.translation - known.world_from_object.translation)[:2]
        spread = place_covariance(known, known.world_from_object, config) + place_covariance(seen, pose, config)
        errors.append(float(gap @ np.linalg.solve(spread, gap)) / 2)
        gaps.append(float(np.linalg.norm(gap)))
    if config.poses == "global" or float(np.median(errors)) <= config.max_misfit:
        return ""
    return (
        f"{len(pairs)} cars agree roughly only, {100 * float(np.median(gaps)):.0f} cm apart in the median: "
        f"{float(np.median(errors)):.0f} variances, {config.max_misfit:g} are allowed (it is chance, or a path is bent)"
    )


def _joined(
    drives: Sequence[Drive], links: Sequence[Link], refused: dict[tuple[int, int], str], middles: Sequence[Floats]
) -> Linking:
    """Components by the most evident links; a link that contradicts more evident ones is a conflict."""
    component = {i: {i: Pose.identity()} for i in range(len(drives))}  # component_from_drive, by the first drive in it
    home = {i: i for i in range(len(drives))}
    kept, conflicts = list[Link](), list[str]()
    for link in sorted(links, key=lambda link: (-link.evidence, link.one, link.other)):
        a, b = home[link.one], home[link.other]
        if a == b:
            other_way = component[a][link.one] @ link.one_from_other
            apart = _apart(other_way, component[a][link.other], middles[link.other])
            if apart:
                conflicts.append(_conflict(drives, link, apart))
                continue
        else:
            a_from_b = component[a][link.one] @ link.one_from_other @ component[b][link.other].inverse()
            for drive, pose in component.pop(b).items():
                component[a][drive], home[drive] = a_from_b @ pose, a
        kept.append(link)
    found = []
    for drives_in in component.values():
        anchor = min(drives_in)
        world_from_component = drives_in[anchor].inverse()
        placed = {i: world_from_component @ pose for i, pose in sorted(drives_in.items())}
        own = tuple(link for link in kept if link.one in placed)
        found.append(Component(anchor, placed, own))
    found.sort(key=lambda c: (-len(c.world_from_drive), c.anchor))
    return Linking(tuple(found), refused, tuple(conflicts))


def _apart(one: Pose, other: Pose, middle: Floats) -> str:
    """By how much two poses differ about a drive's middle (3,), in words; empty if they may be one."""
    turn = float(np.linalg.norm(one.local(other)[3:]))
    far = float(np.linalg.norm(one.transform(middle) - other.transform(middle)))
    if turn <= _DISAGREE_RAD and far <= _DISAGREE_M:
        return ""
    return f"{far:.1f} m and {np.degrees(turn):.1f} deg"


def _conflict(drives: Sequence[Drive], link: Link, apart: str) -> str:
    names = f"{drives[link.one].name} and {drives[link.other].name}"
    return (
        f"{names}: the {len(link.pairs)} cars that they seem to share would lay them {apart} from where other "
        "drives lay them: these cars are not used"
    )


def _middle(seen: Constellation) -> Floats:
    found: Floats = seen.places.mean(0) if len(seen) else np.zeros(3)
    return found
