"""What merging gives: worlds of drives that hang together, each with one map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Pose
from meshslam.maps import Map, Trajectory
from meshslam.merging.drives import Drive
from meshslam.merging.moves import MergedCar


@dataclass(frozen=True, eq=False)
class LaidDrive:
    """A drive in the common world: by which cars it was laid there, and how well they agree."""

    index: int  # the drive's, in the merge's order
    world_from_drive: Pose
    covariance: (
        Floats  # (6, 6), of a right perturbation, (translation, rotation), m and rad; 0 of the world's own drive
    )
    shared_cars: int
    residuals_m: Floats  # (shared_cars,), of the cars' places on the ground
    mean_error: float  # mean squared residual, in variances; 1 is what is expected
    how: str  # world, constellation, given or alone

    def sigmas_at(self, place_in_drive: Floats) -> tuple[float, float]:
        """Standard deviations of the drive's world about a place (3,) of it: metres, all axes together, and degrees."""
        moved = Pose(np.eye(3), place_in_drive).inverse().adjoint()
        there = moved @ self.covariance @ moved.T
        place, turn = (float(np.sqrt(max(0.0, np.trace(part)))) for part in (there[:3, :3], there[3:, 3:]))
        return place, float(np.degrees(turn))


@dataclass(frozen=True, eq=False)
class World:
    """Drives in one world, and its cars: `standing` is the map after the last drive."""

    drives: tuple[LaidDrive, ...]
    cars: tuple[MergedCar, ...]
    variance_factor: float

    def middle_of(self, merged: Merged, laid: LaidDrive) -> Floats:
        """The middle (3,) of a drive's cars, in its own world: the world's origin may be far from the drive."""
        places = [thing.world_from_object.translation for thing in merged.drives[laid.index].map.objects]
        found: Floats = np.mean(places, axis=0) if places else np.zeros(3)
        return found

    @property
    def standing(self) -> Map:
        """The cars that stand where the last drive that could see them saw them."""
        return Map(tuple(car.thing for car in self.cars if car.status != "gone"))

    @property
    def gone(self) -> Map:
        """The cars that have left, where they stood last."""
        return Map(tuple(car.thing for car in self.cars if car.status == "gone"))


@dataclass(frozen=True, eq=False)
class Merged:
    """All worlds, the one of most drives first, and what the user should know.

    Example:
        merged = meshslam.merge(["run1", "run2"])
        merged.map[3].world_from_object, merged.trajectories["run2"]
        [car.status for car in merged.worlds[0].cars]

    """

    drives: tuple[Drive, ...]
    worlds: tuple[World, ...]
    figures: dict[str, float]
    notes: tuple[str, ...]

    @property
    def map(self) -> Map:
        """The first world's cars."""
        return self.worlds[0].standing

    @property
    def trajectories(self) -> dict[str, Trajectory]:
        """The drives' paths in the first world, by name."""
        return self.trajectories_in(self.worlds[0])

    def trajectories_in(self, world: World) -> dict[str, Trajectory]:
        """The same in another world."""
        found = {}
        for laid in world.drives:
            drive = self.drives[laid.index]
            if drive.trajectory is not None:
                poses = tuple(laid.world_from_drive @ pose for pose in drive.trajectory.world_from_camera)
                found[drive.name] = Trajectory(drive.trajectory.times_s, poses)
        return found
