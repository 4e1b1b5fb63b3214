"""Landmarks: each stay of an object in view is one of its own, until a loop closure joins it with an older one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np

from meshslam.categories import Category
from meshslam.geometry import Floats, Pose
from meshslam.graph import Pair
from meshslam.object_slam.loop_closure import LoopClosure, LoopClosureConfig, PlacedLandmark, match_landmarks


@dataclass
class Landmark:
    """An object of the graph, as one stay in view shows it."""

    number: int
    track: int
    world_from_object: Pose  # in the odometry's world, as last estimated
    z: Floats
    dimensions: Floats  # (3,), length, width, height
    views: int = 0
    nearest_m: float = np.inf
    drift_m: float = 0.0  # length of path over which the camera had drifted when it was last seen
    in_map: Pose | None = None  # map_from_object, once it has left the view
    moves: bool = False
    is_withdrawn: bool = False  # no shape of the category explained its observations
    pose_covariance: Floats | None = None  # (6, 6), once it has left the view

    @property
    def counts(self) -> bool:
        """Whether it is an object of the map."""
        return not (self.moves or self.is_withdrawn)

    def placed(self, map_from_odometry: Pose) -> PlacedLandmark:
        """With its place in the map, as far as that is known."""
        pose = map_from_odometry @ self.world_from_object if self.in_map is None else self.in_map
        return PlacedLandmark(self.number, self.track, pose, self.dimensions)


def scale_direction(category: Category) -> Floats:
    """Scale direction of the shape space: modes (M,), of unit length, nearest to a uniform scaling of the mean."""
    modes = category.modes.reshape(len(category.modes), -1).T
    found = np.linalg.lstsq(modes, category.vertices.ravel(), rcond=None)[0]
    length = float(np.linalg.norm(found))
    unit: Floats = np.round(np.asarray(found, float) / length, 10)  # its last bits vary with memory's alignment
    return unit


@dataclass
class OdometryFrame:
    """How far the camera has travelled, and how the odometry's world lies in the map.

    The camera's place in the map has drifted over `drift_m`: a loop closure with a landmark takes it back to where that
    was seen. One that was seen a moment ago takes it back by a moment only.
    """

    map_from_odometry: Pose = field(default_factory=Pose.identity)
    distance_m: float = 0.0
    drift_m: float = 0.0  # the shortest way along the path and loop closures back to the start

    def travel(self, way_m: float) -> None:
        """Go on along the path."""
        self.distance_m += way_m
        self.drift_m += way_m

    def close(self, correction: Pose, known: Iterable[Landmark]) -> None:
        """Move the odometry's world in the map so that landmarks in view are those that are known."""
        self.map_from_odometry = correction @ self.map_from_odometry
        self.drift_m = min([self.drift_m, *(mark.drift_m for mark in known)])


def find_loop_closure(
    landmarks: Mapping[int, Landmark],
    in_view: Set[int],
    joined: Sequence[Pair],
    at: OdometryFrame,
    config: LoopClosureConfig,
) -> LoopClosure | None:
    """Landmarks in view that are older ones, which are not in view."""
    closed = {number for pair in joined for number in pair if number in in_view}
    taken = {old for new, old in joined if new in in_view}
    seen = [
        mark.placed(at.map_from_odometry)
        for number, mark in landmarks.items()
        if number in in_view - closed and mark.views >= config.min_views and mark.nearest_m <= config.max_distance_m
    ]
    known = [mark for number, mark in landmarks.items() if number not in in_view | taken and mark.counts]
    if not seen or not known:
        return None
    drift = [abs(at.drift_m - mark.drift_m) for mark in known]
    radii = [min(config.radius_m + config.drift_share * length, config.max_radius_m) for length in drift]
    return match_landmarks(seen, [mark.placed(at.map_from_odometry) for mark in known], radii, config)


def coincident_landmarks(places: Mapping[int, Pose], joined: Sequence[Pair], within_m: float) -> list[Pair]:
    """Pairs (newer, older) nearer to each other than two cars can stand, that `joined` does not hold as one already."""
    joined = [pair for pair in joined if set(pair) <= set(places)]
    group, found = _groups(places, joined), list[Pair]()
    numbers = sorted(places)
    at = np.array([places[n].translation for n in numbers]).reshape(-1, 3)
    for i, newer in enumerate(numbers):
        for j in np.flatnonzero(np.linalg.norm(at[:i] - at[i], axis=1) < within_m).tolist():
            if group[newer] != group[numbers[j]]:
                found.append((newer, numbers[j]))
                group = _groups(places, [*joined, *found])
    return found


def _groups(numbers: Iterable[int], joined: Sequence[Pair]) -> dict[int, int]:
    """For every landmark the lowest number of those that are one with it."""
    group = {number: number for number in numbers}
    for pair in joined:
        old, new = sorted(group[number] for number in pair)
        group = {number: old if root == new else root for number, root in group.items()}
    return group


def joined_tracks(landmarks: Mapping[int, Landmark], joined: Sequence[Pair]) -> dict[int, int]:
    """For every track that turned out to show an object that another shows too: the lowest of their numbers."""
    group = _groups(landmarks, joined)
    lowest: dict[int, int] = {}
    for number, root in group.items():
        track = landmarks[number].track
        lowest[root] = min(track, lowest.get(root, track))
    names = {landmarks[number].track: lowest[root] for number, root in group.items()}
    return {track: name for track, name in names.items() if track != name}
