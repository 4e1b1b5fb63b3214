"""Drives of one component in one world, with their covariance: places and poses in turns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.graph import DrivePrior, LaidDrives, ObjectInDrive, lay_drives
from meshslam.merging.config import MergingConfig
from meshslam.merging.drives import Drive
from meshslam.merging.links import Component
from meshslam.merging.places import HALF_TURN, Alignment, Place, find_places, own_covariance

_ROUNDS = 6  # of places and poses, until the places stay


@dataclass(frozen=True, eq=False)
class LaidComponent:
    """Drives in one world, and the places where cars stand in it."""

    component: Component
    laid: LaidDrives
    places: tuple[Place, ...]
    aligned: Alignment
    variance_factor: float  # by which all covariances were raised, as the residuals are larger than they say

    def shared(self, drive: int) -> list[Place]:
        """The places that a drive shares with others."""
        return [place for place in self.places if drive in place.members and len(place.members) > 1]


def lay_component(drives: Sequence[Drive], component: Component, config: MergingConfig) -> LaidComponent:
    """Lay a component's drives by the cars that they share, which follow from how they lie."""
    aligned, places, factor = Alignment(component.world_from_drive), list[Place](), 1.0
    for _ in range(_ROUNDS):
        found = find_places(drives, aligned, config)
        if [p.members for p in found] == [p.members for p in places]:
            break
        places = found
        laid = _laid(drives, component, places, aligned.world_from_drive, config)
        factor = _variance_factor(laid)
        laid = laid.inflated(factor)
        own = {drive: laid.covariance(drive, drive) for drive in laid.world_from_drive}
        aligned = Alignment(laid.world_from_drive, own)
    return LaidComponent(component, laid, tuple(places), aligned, factor)


def _laid(
    drives: Sequence[Drive],
    component: Component,
    places: Sequence[Place],
    starts: Mapping[int, Pose],
    config: MergingConfig,
) -> LaidDrives:
    """The graph over the drives and the cars that several share."""
    observations = [
        ObjectInDrive(drive, number, *_observed(drives[drive], place, drive, config))
        for number, place in enumerate(places)
        if len(place.members) > 1
        for drive in sorted(place.members)
    ]
    priors = {drive: _prior(starts[drive], config) for drive in starts}
    return lay_drives(observations, priors, component.anchor, starts)


def _variance_factor(laid: LaidDrives) -> float:
    """Mean squared residual against what the covariances say, 1 at least; what is far off counts as 9 variances."""
    count = len(laid.errors)
    free = 6 * (count - len(laid.world_from_object) - len(laid.world_from_drive) + 1)
    if free <= 0:
        return 1.0
    return max(1.0, sum(min(error, 54.0) for error in laid.errors.values()) / free)


def _observed(drive: Drive, place: Place, index: int, config: MergingConfig) -> tuple[Pose, Floats]:
    """Pose and covariance of a car in its drive, with the heading that the drives agree on."""
    thing = drive.map[place.members[index]]
    pose, covariance = thing.world_from_object, own_covariance(thing, config)
    if index not in place.turned:
        return pose, covariance
    turn = HALF_TURN.inverse().adjoint()
    turned: Floats = turn @ covariance @ turn.T
    return pose @ HALF_TURN, turned


def _prior(start: Pose, config: MergingConfig) -> DrivePrior:
    """Worlds are levelled; those that are one already are also where they are."""
    tilt = float(np.radians(config.tilt_sigma_deg))
    if config.poses == "constellations":
        return DrivePrior(Pose.from_yaw(start.yaw_rad, start.translation), tilt_rad=tilt)
    place, turn = config.global_sigma_m, float(np.radians(config.global_sigma_deg))
    return DrivePrior(Pose.identity(), place, place, tilt, turn)
