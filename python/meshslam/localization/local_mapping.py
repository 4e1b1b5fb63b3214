"""Where in a large map a run starts: its first seconds are mapped by themselves, and their objects looked for in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

from meshslam.errors import SequenceError
from meshslam.geometry import Camera, Pose
from meshslam.localization.config import RelocalizationConfig
from meshslam.localization.map_models import KnownMap
from meshslam.maps import Constellation, ConstellationMatch, find_constellation
from meshslam.motion import NavState
from meshslam.perception import Detection
from meshslam.sequences import ImuSamples

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class LocalMap:
    """What the first seconds show, in a levelled world of their own."""

    first_state: NavState  # of the first frame
    objects: Constellation
    world_from_camera: Mapping[int, Pose]  # of each frame so far


class LocalMapping(Protocol):
    """Maps what is around the camera, frame by frame, from a start that is not known."""

    def take(self, frame: int, time_s: float, imu: ImuSamples | None, detections: tuple[Detection, ...]) -> None:
        """The next frame: its tracked detections, and the samples that came since the last one."""

    def local_map(self) -> LocalMap | None:
        """The map so far; None while there is none."""


@dataclass(frozen=True, eq=False)
class Place:
    """Where in the map the first frames were taken: a local world, true to scale, and its place."""

    map_from_local: Pose
    first_state: NavState  # in the local world
    local_from_camera: Mapping[int, Pose]  # of each frame so far


# of a camera, imu_from_camera, key points by category, and what messages call the recording
MakeLocalMapping = Callable[[Camera, Pose, Mapping[str, tuple[str, ...]], str], LocalMapping]


@dataclass(eq=False)
class PlaceSearch:
    """Takes frames until the objects around them are found in the map."""

    known: KnownMap
    mapping: LocalMapping
    config: RelocalizationConfig
    progress: Progress | None = None
    refused: str = "no object was mapped"  # why nothing was found so far
    first_s: float | None = None
    _searched_s: float = -1e9
    _has_failed: bool = False

    def take(
        self, frame: int, time_s: float, imu: ImuSamples | None, detections: tuple[Detection, ...]
    ) -> Place | None:
        """The next frame; the place, once it is found."""
        self.first_s = time_s if self.first_s is None else self.first_s
        try:
            self.mapping.take(frame, time_s, imu, detections)
        except SequenceError as problem:
            self.refused, self._has_failed = f"the first seconds cannot be mapped: {problem}", True
            return None
        if time_s - self._searched_s < self.config.search_every_s:
            return None
        return self._search(time_s)

    def is_over(self, time_s: float) -> bool:
        """Whether other frames would not help: so many were taken, or they cannot be mapped."""
        return self._has_failed or (self.first_s is not None and time_s - self.first_s > self.config.give_up_s)

    def _search(self, time_s: float) -> Place | None:
        local = self.mapping.local_map()
        if local is None:
            return None
        self._searched_s = time_s
        config = self.config.constellations
        index = self.known.constellations(config.pair_radius_m)
        found = find_constellation(index, local.objects, config, self.progress)
        self.refused = found.refused
        return None if found.refused else _place(local, found)


def _place(local: LocalMap, found: ConstellationMatch) -> Place:
    """A local map's frames in the map."""
    path = {n: _scaled(pose, found.scale) for n, pose in local.world_from_camera.items()}
    own = local.first_state
    grown = replace(
        own,
        world_from_imu=_scaled(own.world_from_imu, found.scale),
        velocity_in_world=found.scale * own.velocity_in_world,
    )
    return Place(found.known_from_seen, grown, path)


def _scaled(pose: Pose, scale: float) -> Pose:
    return Pose(pose.rotation, scale * pose.translation)


def moved_state(state: NavState, there_from_here: Pose) -> NavState:
    """A state in another world."""
    return replace(
        state,
        world_from_imu=there_from_here @ state.world_from_imu,
        velocity_in_world=there_from_here.rotation @ state.velocity_in_world,
    )


def no_local_mapping(known: KnownMap) -> str:
    """What is missing where a large map is given without a start."""
    return (
        f"the map has {len(known)} objects: without a start the place is found by a local map of the first seconds: "
        "give local_mapping=meshslam.object_slam.SlamLocalMapping, or a start"
    )
