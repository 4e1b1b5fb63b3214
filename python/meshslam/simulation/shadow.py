"""Where the sun shines: a depth image from its side, against which points are compared (Williams 1978)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Bools, Camera, Floats, Ints, Pose, render

_FAR_M = 2000.0  # at which the sun's camera stands: its rays are parallel to a degree
_CELL_M = 0.06
_SLACK_M = 0.06  # along the ray; surfaces would shade themselves
_OFFSET_M = 0.05  # along the normal, likewise


@dataclass(frozen=True, eq=False)
class Shadows:
    """What the sun sees around a place."""

    camera: Camera
    camera_from_world: Pose
    inverse_depth: Floats

    @staticmethod
    def of(meshes: Sequence[tuple[Pose, Floats, Ints]], sun: Floats, middle: Floats, reach_m: float) -> Shadows:
        """Draw meshes (world_from_object, vertices, faces) within `reach_m` of a place, seen from the sun (3,)."""
        across = np.cross(sun, [0.0, 0.0, 1.0])
        across /= np.linalg.norm(across)
        rotation = np.stack([across, np.cross(-sun, across), -sun])
        camera_from_world = Pose(rotation, -rotation @ (middle + _FAR_M * sun))
        size = int(2 * reach_m / _CELL_M)
        camera = Camera(size, size, _FAR_M / _CELL_M, _FAR_M / _CELL_M, (size - 1) / 2, (size - 1) / 2)
        drawn = render(camera, [(camera_from_world @ pose, v, f) for pose, v, f in meshes])
        return Shadows(camera, camera_from_world, drawn.inverse_depth)

    def lit(self, points_in_world: Floats, normals_in_world: Floats) -> Bools:
        """Which points (n, 3) nothing hides from the sun; beyond the reach all are lit."""
        placed = self.camera_from_world.transform(points_in_world + _OFFSET_M * normals_in_world)
        at = np.round(self.camera.project(placed)).astype(int)
        inside = (np.clip(at, 0, self.camera.width - 1) == at).all(axis=1)
        x, y = np.where(inside[:, None], at, 0).T
        hidden = self.inverse_depth[y, x] > 1.0 / (placed[:, 2] - _SLACK_M)
        free: Bools = ~(inside & hidden)
        return free
