"""Corners followed over several cameras, as a cost over the cameras alone; the core computes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshslam import _core
from meshslam.geometry.arrays import Bools, Floats
from meshslam.geometry.camera import Camera
from meshslam.geometry.native import floats, geometry_errors
from meshslam.geometry.pose import Pose


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Of a robust cost over (translation, rotation) of each camera, right perturbations."""

    hessian: Floats  # (6 m, 6 m)
    gradient: Floats  # (6 m,)
    cost: float


class TrackedPoints:
    """Tracks that begin in the first of several cameras; each point is where its rays meet, and is eliminated.

    Whoever moves the cameras moves the points with them (Schur complement), so that neither place, heading nor scale
    of all cameras together costs anything. Points whose rays do not meet count by their direction.
    """

    def __init__(self, camera: Camera, tracks: Sequence[Floats], sigma_px: float, kernel: float) -> None:
        """`tracks` are (n, m, 2) px each: n corners in the first m cameras, two or more. `sigma_px` is their noise.

        `kernel` is Geman and McClure's threshold in sigmas. GeometryError for other shapes, and for numbers that are
        not finite.
        """
        self.sigma_px, self.kernel = sigma_px, kernel
        with geometry_errors():
            self._native = _core.TrackedPoints(camera, [floats(t) for t in tracks], sigma_px, kernel)

    @property
    def tracks(self) -> list[Floats]:
        """The tracks (n, m, 2) px as they were given."""
        return self._native.tracks()

    def cost(self, world_from_camera: Sequence[Pose]) -> float:
        """Half the sum of the robust squares, whitened; GeometryError for fewer cameras than the longest track has."""
        with geometry_errors():
            return self._native.cost(_matrices(world_from_camera))

    def normal_equations(self, world_from_camera: Sequence[Pose]) -> NormalEquations:
        """The cost's second order at these cameras (Gauss and Newton, robust weights held); errors as of `cost`."""
        with geometry_errors():
            return NormalEquations(*self._native.normal_equations(_matrices(world_from_camera)))

    def points(self, world_from_camera: Sequence[Pose]) -> tuple[Floats, Bools]:
        """Each track's point (n, 3) in the world, or the direction towards it; and which are points (n,)."""
        with geometry_errors():
            found, finite = self._native.points(_matrices(world_from_camera))
        return found, np.array(finite, bool)


def _matrices(poses: Sequence[Pose]) -> Floats:
    found = np.zeros((len(poses), 4, 4))
    for matrix, pose in zip(found, poses, strict=True):
        matrix[:3, :3], matrix[:3, 3], matrix[3, 3] = pose.rotation, pose.translation, 1.0
    return found
