"""Objects of a run: each time that one comes into view is a landmark of its own, until it is known again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Pose
from meshslam.geometry.arrays import Floats
from meshslam.localization.past import Pair
from meshslam.localization.revisit import Placed, Revisit, RevisitConfig, known_again


@dataclass
class Landmark:
    """An object as one stay in view shows it."""

    number: int
    track: int
    world_from_object: Pose  # in the world of the odometry, as last seen
    z: Floats
    dimensions: Floats  # (3,), length, width, height
    views: int = 0
    nearest_m: float = np.inf
    last_way_m: float = 0.0  # how far the camera had come when it was last seen
    in_map: Pose | None = None  # map_from_object, once it has left the view
    moves: bool = False

    def placed(self, map_from_odometry: Pose) -> Placed:
        """With its place in the map, as far as that is known."""
        pose = map_from_odometry @ self.world_from_object if self.in_map is None else self.in_map
        return Placed(self.number, self.track, pose, self.dimensions)


def growth(category: Category) -> Floats:
    """Modes (M,), of unit length, that come nearest to making the mean shape larger as a whole."""
    modes = category.modes.reshape(len(category.modes), -1).T
    found = np.linalg.lstsq(modes, category.vertices.ravel(), rcond=None)[0]
    length = float(np.linalg.norm(found))
    unit: Floats = np.round(np.asarray(found, float) / length, 10)  # its last bits vary with memory's alignment
    return unit


@dataclass
class Odometer:
    """How far the camera has come, and how the odometry's world lies in the map."""

    map_from_odometry: Pose = field(default_factory=Pose.identity)
    way_m: float = 0.0
    known_at_m: float = 0.0  # the way when an object was last known again


def known_again_in(
    landmarks: Mapping[int, Landmark],
    in_view: Set[int],
    same: Sequence[Pair],
    at: Odometer,
    config: RevisitConfig,
) -> Revisit | None:
    """Landmarks in view that are older ones, which are not in view."""
    joined = {number for pair in same for number in pair if number in in_view}
    taken = {old for new, old in same if new in in_view}
    seen = [
        mark.placed(at.map_from_odometry)
        for number, mark in landmarks.items()
        if number in in_view - joined and mark.views >= config.views and mark.nearest_m <= config.nearest_m
    ]
    known = [mark for number, mark in landmarks.items() if number not in in_view | taken and not mark.moves]
    if not seen or not known:
        return None
    ways = [at.way_m - max(mark.last_way_m, at.known_at_m) for mark in known]
    radii = [min(config.radius_m + config.drift_share * way, config.largest_radius_m) for way in ways]
    return known_again(seen, [mark.placed(at.map_from_odometry) for mark in known], radii, config)


def in_one_place(places: Mapping[int, Pose], same: Sequence[Pair], within_m: float) -> list[Pair]:
    """Pairs (newer, older) nearer to each other than two cars can stand, that `same` does not hold as one already."""
    same = [pair for pair in same if set(pair) <= set(places)]
    group, found = _groups(places, same), list[Pair]()
    numbers = sorted(places)
    at = np.array([places[n].translation for n in numbers]).reshape(-1, 3)
    for i, newer in enumerate(numbers):
        for j in np.flatnonzero(np.linalg.norm(at[:i] - at[i], axis=1) < within_m).tolist():
            if group[newer] != group[numbers[j]]:
                found.append((newer, numbers[j]))
                group = _groups(places, [*same, *found])
    return found


def _groups(numbers: Iterable[int], same: Sequence[Pair]) -> dict[int, int]:
    """For every landmark the lowest number of those that are one with it."""
    group = {number: number for number in numbers}
    for pair in same:
        old, new = sorted(group[number] for number in pair)
        group = {number: old if root == new else root for number, root in group.items()}
    return group


def joined_tracks(landmarks: Mapping[int, Landmark], same: Sequence[Pair]) -> dict[int, int]:
    """For every track that turned out to show an object that another shows too: the lowest of their numbers."""
    group = _groups(landmarks, same)
    lowest: dict[int, int] = {}
    for number, root in group.items():
        track = landmarks[number].track
        lowest[root] = min(track, lowest.get(root, track))
    names = {landmarks[number].track: lowest[root] for number, root in group.items()}
    return {track: name for track, name in names.items() if track != name}
