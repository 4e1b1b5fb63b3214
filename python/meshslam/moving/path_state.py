"""What is estimated of an object that drives: a pose, a speed and a curvature at each time, and one shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshslam.geometry import Floats, Pose, exp_so3

NODE_WIDTH = 8  # translation, rotation, speed, curvature


@dataclass(frozen=True, eq=False)
class PathState:
    """n poses with what drives them from one to the next.

    A step of a node is (translation, rotation, speed, curvature): a right perturbation of the pose, metres and radians,
    and differences in m/s and 1/m.
    """

    rotations: Floats  # (n, 3, 3), world_from_object
    translations: Floats  # (n, 3), metres
    speeds_m_s: Floats  # (n,), of the rear axle's middle along the object's x, negative backwards
    curvatures: Floats  # (n,), 1/m, of that point's path, positive to the left
    z: Floats  # (modes,), in standard deviations

    def __len__(self) -> int:
        return len(self.translations)

    @property
    def poses(self) -> tuple[Pose, ...]:
        """world_from_object at each time."""
        return tuple(Pose(r, t) for r, t in zip(self.rotations, self.translations, strict=True))

    @property
    def turn_rates_rad_s(self) -> Floats:
        """Turn rates (n,) about the object's z."""
        rates: Floats = self.speeds_m_s * self.curvatures
        return rates

    def retract(self, step: Floats) -> PathState:
        """Move by the steps of all nodes, then of the modes where there are any."""
        count = NODE_WIDTH * len(self)
        nodes = step[:count].reshape(-1, NODE_WIDTH)
        return PathState(
            self.rotations @ exp_so3(nodes[:, 3:6]),
            self.translations + (self.rotations @ nodes[:, :3, None])[..., 0],
            self.speeds_m_s + nodes[:, 6],
            self.curvatures + nodes[:, 7],
            self.z + step[count:] if len(step) > count else self.z,
        )

    @staticmethod
    def of(poses: tuple[Pose, ...], speeds_m_s: Floats, curvatures: Floats, z: Floats) -> PathState:
        """The state at poses."""
        turns, places = np.array([p.rotation for p in poses]), np.array([p.translation for p in poses])
        return PathState(turns, places, speeds_m_s, curvatures, z)
