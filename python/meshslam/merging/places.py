"""Cars of several drives that stand in one place are one car."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.maps import MapObject
from meshslam.merging.config import MergingConfig
from meshslam.merging.drives import Drive

HALF_TURN = Pose.from_yaw(np.pi, np.zeros(3))
_HEADING_DEG = 15.0  # by which the headings of one car may differ, either way round
_ROUGH_M = 0.5  # of drives that are laid by their constellations alone


@dataclass(frozen=True, eq=False)
class Place:
    """A car that stands in one place: its number in each drive that mapped it there."""

    members: dict[int, int]  # ids by drive
    turned: frozenset[int] = frozenset()  # drives that took it the wrong way round

    @property
    def key(self) -> tuple[int, int]:
        """The first drive and the car's number there: places are told apart by it."""
        drive = min(self.members)
        return drive, self.members[drive]


@dataclass(frozen=True, eq=False)
class Alignment:
    """Where drives lie, and how well that is known; a rough one knows nothing of that."""

    world_from_drive: Mapping[int, Pose]
    covariances: Mapping[int, Floats] | None = None  # (6, 6), of right perturbations

    def of_object(self, drive: int, drive_from_object: Pose) -> Floats:
        """Covariance (6, 6) that the drive's own gives to an object, of a right perturbation of its pose."""
        if self.covariances is None:
            return np.diag([_ROUGH_M**2] * 3 + [np.radians(_HEADING_DEG) ** 2] * 3)
        moved = drive_from_object.inverse().adjoint()
        found: Floats = moved @ self.covariances[drive] @ moved.T
        return found


def own_covariance(thing: MapObject, config: MergingConfig) -> Floats:
    """Covariance (6, 6) of a car in its drive: its own, and the error of the path there."""
    place, heading = config.unknown_place_sigma_m, np.radians(config.unknown_heading_sigma_deg)
    unknown = np.diag([place**2] * 3 + [heading**2] * 3)
    path = np.diag([config.place_sigma_m**2] * 3 + [np.radians(config.heading_sigma_deg) ** 2] * 3)
    found: Floats = (unknown if thing.pose_covariance is None else thing.pose_covariance) + path
    return found


def place_covariance(thing: MapObject, world_from_object: Pose, config: MergingConfig) -> Floats:
    """Covariance (2, 2) of a car's place on the ground, in a world where it stands so, if that world is exact."""
    turn = world_from_object.rotation
    found: Floats = (turn @ own_covariance(thing, config)[:3, :3] @ turn.T)[:2, :2]
    return found


def find_places(drives: Sequence[Drive], aligned: Alignment, config: MergingConfig) -> list[Place]:
    """The places of all cars of the aligned drives, drive by drive: each car takes the nearest that it may be."""
    found: list[Place] = []
    for drive in sorted(aligned.world_from_drive):
        things = drives[drive].map.objects
        allowed = [
            (gap, place, k)
            for place, there in enumerate(found)
            for k, thing in enumerate(things)
            if (gap := _gap(drives, aligned, there, drive, thing, config)) is not None
        ]
        taken = dict[int, int]()
        for _, place, k in sorted(allowed):
            if place not in taken and k not in taken.values():
                taken[place] = k
        for place, k in taken.items():
            found[place] = _with(drives, aligned, found[place], drive, things[k])
        new = [thing for k, thing in enumerate(things) if k not in taken.values()]
        found += [Place({drive: thing.id}) for thing in new]
    return found


def pose_of(drives: Sequence[Drive], aligned: Alignment, drive: int, number: int) -> Pose:
    """world_from_object of a car as a drive has it."""
    return aligned.world_from_drive[drive] @ drives[drive].map[number].world_from_object


def one_size(one: MapObject, other: MapObject, ratio: float) -> bool:
    """Whether two cars may be one by category, length, width and height."""
    return one.category == other.category and bool(np.abs(np.log(one.dimensions / other.dimensions)).max() <= ratio)


def _gap(
    drives: Sequence[Drive], aligned: Alignment, place: Place, drive: int, thing: MapObject, config: MergingConfig
) -> float | None:
    """Distance in sigmas from where others saw it, on the ground; None if it is another car."""
    gaps = []
    pose = aligned.world_from_drive[drive] @ thing.world_from_object
    for other, number in place.members.items():
        known = drives[other].map[number]
        if not one_size(known, thing, config.size_ratio):
            return None
        there = pose_of(drives, aligned, other, number)
        apart = (pose.translation - there.translation)[:2]
        if abs(float(pose.rotation[:, 0] @ there.rotation[:, 0])) < np.cos(np.radians(_HEADING_DEG)):
            return None
        spread = _on_ground(aligned, drive, thing, pose, config) + _on_ground(aligned, other, known, there, config)
        sigmas = float(np.sqrt(apart @ np.linalg.solve(spread, apart)))
        if sigmas > config.moved_sigmas and float(np.linalg.norm(apart)) > config.min_moved_m:
            return None
        gaps.append(sigmas)
    return float(np.mean(gaps))


def _on_ground(aligned: Alignment, drive: int, thing: MapObject, pose: Pose, config: MergingConfig) -> Floats:
    """Covariance (2, 2) of a car's place along the world's x and y."""
    along = own_covariance(thing, config) + aligned.of_object(drive, thing.world_from_object)
    found: Floats = (pose.rotation @ along[:3, :3] @ pose.rotation.T)[:2, :2]
    return found


def _with(drives: Sequence[Drive], aligned: Alignment, place: Place, drive: int, thing: MapObject) -> Place:
    """The place with one drive more; the heading is that which more views speak for."""
    heading = (aligned.world_from_drive[drive] @ thing.world_from_object).rotation[:, 0]
    first, number = place.key
    agrees = float(heading @ pose_of(drives, aligned, first, number).rotation[:, 0]) > 0
    turned = place.turned if agrees == (first not in place.turned) else place.turned | {drive}
    members = {**place.members, drive: thing.id}
    views = {d: max(1, drives[d].map[n].views) for d, n in members.items()}
    if sum(views[d] for d in turned) > sum(views[d] for d in members if d not in turned):
        turned = frozenset(members) - turned
    return replace(place, members=members, turned=turned)
