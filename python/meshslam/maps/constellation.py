"""Parked objects seen from above, and what is assumed of them where two sets of them are compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshslam.geometry import Floats
from meshslam.maps.objects import MapObject
from meshslam.settings import Settings, expert


@dataclass(frozen=True)
class ConstellationConfig(Settings):
    """When two sets of objects are the same street."""

    pair_radius_m: float = expert(40.0, above=0)  # two objects that vote are nearer to each other than this
    place_sigma_m: float = expert(0.15, above=0)  # of an object in its drive, beside its own covariance,
    drift_share: float = expert(0.01, low=0, high=1)  # and so much more of its distance to the others
    scale_sigma: float = expert(0.0, low=0, high=0.5)  # of one set's lengths against the other's; 0: they are the same
    height_sigma_m: float = expert(0.4, above=0)
    heading_sigma_deg: float = expert(4.0, above=0, high=45)
    size_sigma: float = expert(0.04, above=0)  # of length, width, height, as logarithm
    size_spread: float = expert(0.1, above=0)  # of different cars' sizes
    cars_per_m2: float = expert(0.05, above=0)  # along a kerb, by chance
    unshared_cost: float = expert(1.0, low=0)  # of evidence, for each object beside shared ones that is not shared
    candidates: int = expert(60, low=2)  # that are verified
    min_objects: int = expert(3, low=2)  # that two sets must share
    min_evidence: float = expert(6.0, low=0)  # logarithm of the odds against chance
    min_agreement: float = expert(4.4, low=0)  # of evidence for each shared object: regular streets agree roughly
    max_ambiguity: float = expert(0.7, low=0, high=1)  # evidence of the next best place, as a share of the best one's


@dataclass(frozen=True, eq=False)
class Constellation:
    """Parked objects in a world whose z is up; rows are objects.

    Example:
        seen = Constellation.of(meshslam.Map.load("run").objects)
        seen.places, seen.sizes  # (n, 3), (n, 3), metres

    """

    places: Floats  # (n, 3), metres
    yaws_rad: Floats  # (n,)
    sizes: Floats  # (n, 3): length, width, height, metres
    sigmas_m: Floats  # (n,), of the place, along each horizontal axis

    def __len__(self) -> int:
        return len(self.places)

    @property
    def extent_m(self) -> float:
        """How far the objects reach on the ground: the diagonal of their places' box."""
        return float(np.linalg.norm(np.ptp(self.places[:, :2], axis=0)))

    def scaled(self, scale: float) -> Constellation:
        """The same with all lengths multiplied."""
        return self if scale == 1.0 else replace(self, places=scale * self.places, sizes=scale * self.sizes)

    @staticmethod
    def of(objects: Sequence[MapObject]) -> Constellation:
        """The constellation of a map's objects, in their order."""
        return Constellation(
            np.array([o.world_from_object.translation for o in objects]).reshape(-1, 3),
            np.array([o.world_from_object.yaw_rad for o in objects]),
            np.array([o.dimensions for o in objects]).reshape(-1, 3),
            np.sqrt(np.array([_horizontal_variance_m2(o) for o in objects])),
        )


def _horizontal_variance_m2(thing: MapObject) -> float:
    """Variance of the place along a horizontal axis, mean of two; 0 where it is not known."""
    if thing.covariance is None:
        return 0.0
    turn = thing.world_from_object.rotation
    in_world = turn @ thing.covariance[:3, :3] @ turn.T
    return float(in_world[0, 0] + in_world[1, 1]) / 2


def turned(points: Floats, yaws_rad: Floats | float) -> Floats:
    """Points (..., 2) turned about the origin, each by its angle or all by one."""
    c, s = np.cos(yaws_rad), np.sin(yaws_rad)
    return np.stack([c * points[..., 0] - s * points[..., 1], s * points[..., 0] + c * points[..., 1]], -1)


def headings_apart(one_rad: Floats, other_rad: Floats) -> Floats:
    """Difference of headings, radians, from -pi/2 to pi/2: an object taken the wrong way round has the same."""
    return (one_rad - other_rad + np.pi / 2) % np.pi - np.pi / 2
